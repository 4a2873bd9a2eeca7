"""The options of a dataset run: one list for the command line, the case file's [dataset] table and the record."""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..files.keys import nearest_name
from .stereo import LEFT, RIGHT, camera_from_planned, further_eyes

if TYPE_CHECKING:
    import numpy as np

ENGINES = {"cycles": "exact", "raster": "as exact and faster", "eevee": "needs OpenGL"}
"""Each is a file of :mod:`oneframe.blender.render`."""
COLOURS = {"projective": "exact at every shaded point", "vertex": "the paper's method"}
UNSEEN = {
    "neutral": "grey",
    "fill": "the observed colours, continued smoothly over the surface, with a light over its shadow in the frame too",
}
KEEP, DROP = "keep", "drop"
HIGHLIGHTS = {
    KEEP: "as the frame shows them, where they were",
    DROP: "not seen: they are the lamp's reflection, and would stay behind when it moves",
}
NONE, LENS, SHADOWS = "none", "lens", "shadows"
LIGHTS = {
    NONE: "colours as the frame has them, with its shading",
    LENS: "the lamp at the lens, [light] in the case, moves with it",
    SHADOWS: "so do the shadows that it casts; not by eevee",
}
FRAME = "frame"
SURROUNDINGS = {
    NONE: "black",
    FRAME: "what the frame shows there, on a sheet that continues the surface; mask_surround alone has it",
}
EYES = {LEFT: "the poses themselves", RIGHT: "beside them"}
FOR_TRAINING: dict[str, object] = {
    "unseen": "fill", "highlights": DROP, "surroundings": FRAME, "light": SHADOWS, "max_incidence_deg": 80.0
}  # fmt: skip
"""What networks learned from most, see ``docs/training.md``; the light as far as case and engine have it."""


@dataclass(frozen=True)
class Sampler:
    """A distribution of poses.

    Attributes
    ----------
    place
        Module of :mod:`oneframe.poses` and class, which has the reach, joined by a colon.
    about
        How the poses lie.
    options
        Names of the options that the class takes.
    grows
        Whether a view's pose stays the same when views are added.
    """

    place: str
    about: str
    options: tuple[str, ...]
    grows: bool = True

    def values(self, options: "DatasetOptions") -> dict[str, float]:
        """What options say about its own."""
        return {name: getattr(options, name) for name in self.options}


SAMPLERS = {
    "cone": Sampler(
        "distributions:Cone",
        "tilt within a cone about the frame's viewing direction, roll, distance, lateral shift",
        ("cone_deg", "roll_deg", "distance_min", "distance_max", "shift_mm"),
    ),
    "gaussian": Sampler(
        "distributions:Gaussian", "normally distributed in se(3) around the frame's pose", ("sigma_deg", "sigma_mm")
    ),
    "shell": Sampler(
        "distributions:Shell",
        "uniform in the volume of a part of a spherical shell",
        ("polar_deg", "roll_deg", "distance_min", "distance_max"),
    ),
    "trajectory": Sampler(
        "distributions:Trajectory",
        "along a smooth closed curve",
        ("cone_deg", "roll_deg", "distance_min", "distance_max"),
        grows=False,
    ),
}
LARGEST_NUMBER = 2**53
"""Whole numbers beyond this have no exact float, and no option needs them."""


@dataclass(frozen=True)
class Option:
    """The declaration of an option.

    Attributes
    ----------
    about
        What it is.
    group
        Heading of ``--help``.
    name
        What the window calls it, without unit; the option's own name if left out.
    unit
        Of a number.
    least, most
        Limits of a number.
    choices
        The values of a text, and what each is.
    is_content
        Whether it belongs to the identity of a dataset, so that no view may be made with another value.
    key, kind, default
        Name, type and default of its field in :class:`DatasetOptions`.
    """

    about: str
    group: str = "views"
    name: str = ""
    unit: str = ""
    least: float = -math.inf
    most: float = math.inf
    choices: Mapping[str, str] = field(default_factory=dict)
    is_content: bool = True
    key: str = ""
    kind: Any = None
    default: Any = None

    @property
    def flag(self) -> str:
        """On the command line."""
        return "--" + self.key.replace("_", "-")

    @property
    def label(self) -> str:
        """In the window."""
        unit = f" ({self.unit})" if self.unit else ""
        return (self.name or self.key.replace("_", " ").title()) + unit

    @property
    def text(self) -> str:
        """What it is, with its choices, or the samplers that have it, for ``--help`` and the window."""
        used_by = [name for name, sampler in SAMPLERS.items() if self.key in sampler.options]
        choices = "; ".join(f"{choice} ({about})" for choice, about in self.choices.items())
        return ": ".join(filter(None, (", ".join(used_by), self.about, choices)))


def _option(default: Any, about: str, **declared: Any) -> Any:
    return field(default=default, metadata={"option": Option(about, **declared)})


_pose = partial(_option, group="poses")
_constraint = partial(_option, group="constraints on poses")
_video = partial(_option, group="video", is_content=False)
_stereo = partial(_option, group="stereo")


@dataclass(frozen=True)
class DatasetOptions:
    """Everything that determines the content of a dataset in addition to the case."""

    # count and poses are in a description under keys of their own, as they may grow
    count: int = _option(100, "number of views", name="Views", least=1, most=10_000_000, is_content=False)
    seed: int = _pose(0, "seed of the poses; view i depends only on the seed and i", least=0)
    poses: str | None = _pose(
        None, "explicit poses cam_from_mesh, in the frame of the mesh file: .npy (N x 4 x 4), a JSON list, or a table "
        "of BOP or COLMAP; they replace the sampler and --count", is_content=False,
    )  # fmt: skip
    scale: float = _option(
        1.0, "size of the views relative to the frame's", name="Image Size", unit="×", least=1 / 64, most=8
    )
    engine: str = _option("cycles", "renderer", choices=ENGINES)
    samples: int = _option(
        1, "1: one exact ray through each pixel centre; more: anti-aliased, with this many rays in each pixel that an "
        "edge crosses. Depth and masks are exact either way", name="Rays at Edges", least=1, most=256,
    )  # fmt: skip
    colour: str = _option("projective", "how the frame colours the surface", choices=COLOURS)
    unseen: str = _option("neutral", "surface that the frame did not see", name="Unseen Surface", choices=UNSEEN)
    highlights: str = _option(KEEP, "highlights of a frame", choices=HIGHLIGHTS)
    light: str = _option(NONE, "light of the views", choices=LIGHTS)
    max_incidence_deg: float = _option(
        87.0, "largest angle between the frame's ray and the surface's normal at which surface counts as "
        "seen; what the frame sees at a grazing angle is stretched to streaks in other views",
        name="Incidence", unit="°", least=0, most=90,
    )  # fmt: skip
    float_depth: bool = _option(False, "also write depth as float32 millimetres (.npy)")
    normals: bool = _option(False, "also write the surface's normals in the camera's axes (16-bit .png)")
    points: bool = _option(
        False, "also write the surface's point at each pixel, its object coordinates, as float32 millimetres (.npy)",
    )  # fmt: skip
    occluders: float = _option(
        0.0, "mean number of instruments in front of the surface of a view, at random places and by a stream of their "
        "own; mask_visib is without what they cover, mask_occluder they alone", name="Instruments", least=0, most=10,
    )  # fmt: skip
    surroundings: str = _option(NONE, "beyond the surface's edge", choices=SURROUNDINGS)
    video: bool = _video(False, "also render a smooth trajectory as MP4 with its poses")
    video_frames: int = _video(120, "length of the video in frames (24 per second)", least=2)
    stereo_mm: float = _stereo(
        0.0, "distance of a right eye beside each view, rendered as a dataset of its own into the folder right; 0: no",
        name="Stereo", unit="mm", least=0,
    )  # fmt: skip
    converge_mm: float = _stereo(
        0.0, "distance from both eyes at which their axes meet, the working distance of a microscope; 0: parallel",
        name="Converge", unit="mm", least=0,
    )  # fmt: skip
    eye: str = _stereo(LEFT, "which of the two is rendered", choices=EYES)
    sampler: str = _pose(
        "cone", "distribution of poses around the frame's pose", name="Poses",
        choices={name: sampler.about for name, sampler in SAMPLERS.items()},
    )  # fmt: skip
    cone_deg: float = _pose(20.0, "largest tilt of the viewing direction", name="Max Tilt", unit="°", least=0, most=180)
    roll_deg: float = _pose(15.0, "largest in-plane roll, either way", name="Max Roll", unit="°", least=0, most=180)
    distance_min: float = _pose(0.9, "smallest distance, relative to the frame's", name="Nearest", unit="×", least=0.01)
    distance_max: float = _pose(1.1, "largest distance, relative to the frame's", name="Farthest", unit="×", least=0.01)
    shift_mm: float = _pose(2.0, "largest lateral shift in the image plane", name="Max Shift", unit="mm", least=0)
    sigma_deg: float = _pose(
        5.0, "standard deviation of the rotation about each axis", name="Rotation σ", unit="°", least=0, most=60
    )
    sigma_mm: float = _pose(
        3.0, "standard deviation of the translation along each axis", name="Translation σ", unit="mm", least=0
    )
    polar_deg: float = _pose(
        60.0, "largest angle from the frame's viewing direction", name="Max Angle", unit="°", least=0, most=180
    )
    min_observed: float = _constraint(0.5, "least observed fraction of the surface in a view", least=0, most=1)
    min_surface: float = _constraint(
        0.3, "least fraction of a view that the surface covers, relative to the frame's", least=0, most=1
    )
    min_clearance_mm: float = _constraint(
        5.0, "least distance from camera to surface", name="Clearance", unit="mm", least=0
    )

    def content(self) -> dict[str, object]:
        """The values that belong to the identity of a dataset, by name."""
        return {name: getattr(self, name) for name, option in OPTIONS.items() if option.is_content}

    @property
    def camera_from_planned(self) -> "np.ndarray | None":
        """As of :func:`.stereo.camera_from_planned`."""
        return camera_from_planned(self.content())

    def further(self) -> dict[str, "DatasetOptions"]:
        """The datasets that belong into the folder of one with these options: their folders and options."""
        return {eye: dataclasses.replace(self, eye=eye, video=False) for eye in further_eyes(self.content())}


OPTIONS: dict[str, Option] = {
    entry.name: dataclasses.replace(entry.metadata["option"], key=entry.name, kind=entry.type, default=entry.default)
    for entry in dataclasses.fields(DatasetOptions)
}
"""Every option, by its name, in their order."""
PATHS = {"poses"}
"""Those that name files, in a case from its folder; the window has none of them."""


def option_groups() -> dict[str, list[Option]]:
    """The options by their heading."""
    groups: dict[str, list[Option]] = {}
    for option in OPTIONS.values():
        groups.setdefault(option.group, []).append(option)
    return groups


def checked_options(values: Mapping[str, object], where: str) -> DatasetOptions:
    """Check options in a mapping such as the [dataset] table; those that are missing keep their defaults."""
    return checked_together(checked_values(values, where), where)


def checked_values(values: Mapping[str, object], where: str) -> dict[str, object]:
    """Check each option by itself, as :func:`checked_options`."""
    for name in values:
        if name not in OPTIONS:
            raise InputError(f"{where}: unknown option {name!r}; {nearest_name(name, tuple(OPTIONS))}")
    return {name: _checked_value(OPTIONS[name], value, where) for name, value in values.items()}


def checked_together(checked: Mapping[str, object], where: str) -> DatasetOptions:
    """The options of these values, each checked, if they can be together, as :func:`checked_options`."""
    options = DatasetOptions(**checked)  # type: ignore[arg-type]
    if options.distance_min > options.distance_max:
        raise InputError(
            f"{where}: expected distance_min <= distance_max, found {options.distance_min:g} > "
            f"{options.distance_max:g}; swap them"
        )
    if options.converge_mm and not 0 < options.stereo_mm <= options.converge_mm:
        raise InputError(
            f"{where}: expected converge_mm of at least stereo_mm, and that above 0, found {options.converge_mm:g} and "
            f"{options.stereo_mm:g} mm; give the working distance and the eyes' distance, or 0 for parallel axes"
        )
    if options.eye == RIGHT and not options.stereo_mm:
        raise InputError(f"{where}: expected stereo_mm with the right eye, found none; give the eyes' distance")
    return options


def _checked_value(option: Option, value: Any, where: str) -> object:
    kind, where = option.kind, f"{where}: {option.key}"
    if kind is bool:
        if not isinstance(value, bool):
            raise InputError(f"{where}: expected true or false, found {value!r}")
        return value
    if kind not in (int, float):
        choices = tuple(option.choices)
        if not isinstance(value, str) or (choices and value not in choices):
            hint = f"; {nearest_name(value, choices)}" if choices and isinstance(value, str) else ""
            raise InputError(f"{where}: expected {' or '.join(choices or ('a file name',))}, found {value!r}{hint}")
        return value
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_NUMBER
    if not is_number or (kind is int and value != int(value)):
        raise InputError(f"{where}: expected a {'whole ' if kind is int else ''}number, found {value!r}")
    least, most = option.least, option.most
    if not least <= value <= most:
        limits = f"at least {least:g}" if most == math.inf else f"{least:g} to {most:g}"
        raise InputError(f"{where}: expected {limits}, found {value!r}")
    return kind(value)
