"""No more model than a dataset needs: the settings that may render its views, and how they are written down.

With ``--quality exact`` views are ray traced from the surface as given. With ``auto`` and ``draft``, a run measures the
error of cheaper settings in pilot views and takes the cheapest that holds the tolerance. Which one that is depends on
errors and on a fixed model of the cost, never on times, so it is the same on every machine.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..camera.pinhole import PinholeCamera
from ..errors import RunError
from ..surface.mesh import TriangleMesh
from .layout import RECORD
from .options import DatasetOptions
from .view_error import ViewError

DRAFT_FACTOR = 4.0
"""How much larger the tolerances of a draft are."""

REDUCTIONS = (16.0, 8.0, 4.0)
"""Tolerances of reductions of the surface, in tolerances of outlines at the nearest pixel, the coarsest first.

An outline moves by much less on average than the surface at most: by 0.01 px where eight times 0.1 px were allowed, on
the surface of a CT.
"""

PIXEL_COST, FACE_COST = {"cycles": 0.65, "z-buffer": 0.13}, {"cycles": 0.02, "z-buffer": 0.3}
"""Microseconds of a core for every pixel and every face, from views of 0.7 million pixels of surfaces of 0.2 and
2.3 million faces on one machine."""

FEW_FACES = 0.2
"""Faces for every pixel of a view up to which pixels cost the z-buffer more: a reduction has little to gain."""

SETTING = "setting"
"""The key of the setting in ``dataset.json``."""

SAMPLES_COST = 1.5
"""Factor of the time of pixels for anti-aliased views."""


@dataclass(frozen=True)
class Setting:
    """How views are rendered.

    Attributes
    ----------
    renderer
        ``"cycles"``, or ``"z-buffer"``: :mod:`pipeline.blender.render.z_buffer_view`.
    colour, samples
        As in the options.
    mesh_tolerance_mm
        Largest distance of the rendered surface from the one given, the bound of errors of depth: 0 if it is the same.
    faces
        Faces of the surface that is rendered.
    pivot_model
        The point of the surface, as given, on which poses pivot, mm.
    surface_sha256
        Hash of the geometry that is rendered.
    """

    renderer: str
    colour: str
    samples: int
    mesh_tolerance_mm: float
    faces: int
    pivot_model: tuple[float, float, float]
    surface_sha256: str

    def to_json(self) -> dict[str, object]:
        """The setting in ``dataset.json``."""
        return asdict(self)


def setting_in(description: Mapping[str, Any], where: str) -> Setting | None:
    """The setting in the description of a dataset; ``None`` if its quality is ``exact``.

    Raises
    ------
    RunError
        There is something else in its place.
    """
    if SETTING not in description:
        return None
    try:
        return _setting(description[SETTING])
    except (TypeError, KeyError, ValueError, AttributeError):
        raise RunError(
            f"{where}: expected the setting that a run has chosen, found something else; choose another folder (--out)"
        ) from None


def stored_setting(out: Path) -> Setting | None:
    """The setting of the dataset in a folder, if there is one, whole and of another quality than ``exact``.

    Raises
    ------
    RunError
        There is something else in its place.
    OSError
        The description cannot be read.
    """
    try:
        content = json.loads((out / RECORD).read_bytes())
    except (FileNotFoundError, ValueError, RecursionError):
        return None
    return setting_in(content, str(out / RECORD)) if isinstance(content, dict) else None


def _setting(content: Mapping[str, Any]) -> Setting:
    x, y, z = map(float, content["pivot_model"])
    return Setting(
        renderer=_known(content["renderer"], tuple(PIXEL_COST)),
        colour=str(content["colour"]),
        samples=int(content["samples"]),
        mesh_tolerance_mm=float(content["mesh_tolerance_mm"]),
        faces=int(content["faces"]),
        pivot_model=(x, y, z),
        surface_sha256=str(content["surface_sha256"]),
    )


def _known(value: str, values: Sequence[str]) -> str:
    if value not in values:
        raise ValueError(value)
    return value


def tolerance_of(options: DatasetOptions) -> ViewError:
    """The errors that a run may make."""
    factor = DRAFT_FACTOR if options.quality == "draft" else 1.0
    return ViewError(factor * options.tolerance_colour, factor * options.tolerance_px)


def cost(renderer: str, samples: int, camera: PinholeCamera, mesh: TriangleMesh) -> float:
    """Milliseconds of a core for a view of a surface, by the fixed model."""
    pixels = (SAMPLES_COST if samples > 1 else 1.0) * camera.width * camera.height
    return 1e-3 * (PIXEL_COST[renderer] * pixels + FACE_COST[renderer] * len(mesh.faces))


def renderings(options: DatasetOptions) -> list[tuple[str, str, int]]:
    """Renderers with colour mode and samples that may stand in for the options."""
    # a baked texture shows what the projection does
    colours = dict.fromkeys(("projective" if options.colour == "texture" else options.colour, options.colour))
    samples = dict.fromkeys((1, options.samples))
    # the z-buffer knows no colours but the frame's
    can_raster = "projective" in colours and options.unseen == "neutral"
    rastered = [("z-buffer", "projective", 1)] if can_raster else []
    return rastered + [("cycles", colour, count) for colour in colours for count in samples]
