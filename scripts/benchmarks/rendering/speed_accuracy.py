"""Speed against accuracy: what a configuration costs and how far its views are off, as rows of a table.

Smaller is better in both, so the Pareto front holds the points than which no other is both faster and more accurate.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

OURS, PEER, FLOOR = "ours", "peer", "floor"
"""Complete views on disk; another program's picture in memory; a part of our work alone, which has no error."""
ENGINE_NAMES = {"cycles": "Cycles", "raster": "raster", "eevee": "Eevee"}


@dataclass(frozen=True)
class Configuration:
    """A way to render a dataset.

    Attributes
    ----------
    engine, samples, colour
        As in :class:`oneframe.dataset.options.DatasetOptions`.
    mesh_px
        Tolerance to which the surface is simplified, in pixels of the views; 0 is the whole surface.
    processes
        Number of processes, which share the cores; 0 for one per core.
    more
        Values of further options of ``render_dataset.py`` by name.
    """

    engine: str = "cycles"
    samples: int = 1
    colour: str = "projective"
    mesh_px: float = 0.0
    processes: int = 0
    more: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """What distinguishes it, for people."""
        parts = [ENGINE_NAMES.get(self.engine, self.engine), self.colour]
        parts.append(f"{self.samples} samples" if self.samples > 1 else "1 sample")
        if self.mesh_px:
            parts.append(f"mesh to {self.mesh_px:g} px")
        if self.processes:
            parts.append(f"{self.processes} process{'es' * (self.processes > 1)}")
        parts += [f"{name} {value}" for name, value in self.more.items()]
        return ", ".join(parts)

    def flags(self, cores: int) -> list[str]:
        """The options of ``render_dataset.py``."""
        values = {
            "engine": self.engine, "samples": self.samples, "colour": self.colour,
            "workers": self.processes or cores, **self.more,
        }  # fmt: skip
        return [f"--{name}={value}" for name, value in values.items()]


@dataclass(frozen=True)
class SpeedPoint:
    """What was measured of a configuration, a peer or a floor in one scene; NaN for what there is not.

    Attributes
    ----------
    scene, kind, name
        The scene; ``OURS``, ``PEER`` or ``FLOOR``; the configuration in words.
    engine, samples, colour, more
        As in :class:`Configuration`, in words; ``more`` as text.
    triangles, processes
        Of the surface; processes that share the cores.
    ms, ms_least, ms_most
        Time of a view: median and range of the rounds.
    error, ssim
        Mean colour error of 255 and SSIM, in the observed surface, against the converged reference.
    photograph_error, photograph_ssim
        The same against photographs.
    photograph_ssim_surface
        SSIM against photographs over the whole surface, also where the frame saw nothing.
    """

    scene: str
    kind: str
    name: str
    engine: str
    samples: int
    colour: str
    more: str
    triangles: int
    processes: int
    ms: float
    ms_least: float
    ms_most: float
    error: float = np.nan
    ssim: float = np.nan
    photograph_error: float = np.nan
    photograph_ssim: float = np.nan
    photograph_ssim_surface: float = np.nan


def pareto_front(costs: Sequence[float], errors: Sequence[float]) -> np.ndarray:
    """``(N,)`` bool: points such that no other is as good in both and better in one. NaN is never on the front.

    Of equal points all are on the front or none.
    """
    points = np.stack([np.asarray(costs, float), np.asarray(errors, float)], axis=1).reshape(-1, 2)
    better_or_equal = (points[:, None] <= points[None]).all(axis=2)
    better = (points[:, None] < points[None]).any(axis=2)
    return ~(better_or_equal & better).any(axis=0) & np.isfinite(points).all(axis=1)
