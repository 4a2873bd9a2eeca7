"""What the pipeline says, in the words of the window: labels of the panel instead of options."""

import re
from collections.abc import Mapping
from pathlib import Path

from ..pipeline.dataset.differences import DEPTH_SCALE, LISTED, Difference
from ..pipeline.dataset.options import COLOURS, ENGINES
from ..state.properties import LABELS, label

_INPUTS = {"frame": "the frame's image", "surface": "the surface's file"}
_FRAME = {"cam_from_model": "the pose", "distortion": "the distortion"}
_PROGRAMS = {"oneframe": "OneFrame", "blender": "Blender"}

_SENTENCES = (
    (" (--out)", ""),
    ("run the same command again", "press Render Dataset again"),
    ("start the run again", "press Render Dataset again"),
)


def in_window_words(message: str) -> str:
    """A message of the pipeline for the window: ``--engine cycles`` becomes ``Engine Cycles``."""
    for words, own in _SENTENCES:
        message = message.replace(words, own)
    # other names, such as "distance", are words as well
    message = re.sub(r"\b[a-z]+(?:_[a-z]+)+\b", lambda found: LABELS.get(found[0], found[0]), message)
    return re.sub(r"--([a-z][a-z-]*)(?: ([a-z]+)\b)?", _named, message)


def in_words(change: Difference, files: Mapping[str, Path]) -> str | None:
    """A difference between a dataset and the settings, as a clause; ``None`` if it follows from another one.

    Parameters
    ----------
    change
        The difference.
    files
        The files that the views would depend on, by the names in the description.
    """
    group, _, name = change.key.partition(".")
    if change.of_input is not None:
        file = files.get(change.of_input)
        what = _INPUTS.get(change.of_input, change.of_input)
        return f"{what} has changed" if file is None else f"{what} ({file.name}) has changed"
    if change.key == "options.views":
        return f"a trajectory of {change.found} views cannot grow, {label('count')} is {change.asked}"
    if group == "options":
        return f"{label(name)} was {_shown(change.found)}, is {_shown(change.asked)}"
    if group == "frame":
        return f"{_FRAME.get(name, 'K of the camera')} has changed"
    if group == "versions":
        return f"it was made with {_PROGRAMS.get(name, name)} {change.found}, this is {change.asked}"
    if group == "structures":
        return f"the colour of the structure {name} has changed"
    if change.key == "mm_per_unit":
        return "the unit of the surface has changed"
    if change.key == DEPTH_SCALE and None not in (change.found, change.asked):
        return "the poses of the list reach to another depth, for which depth images have another scale"
    if change.key == DEPTH_SCALE:
        return f"the poses were {'drawn' if change.found is None else 'listed'}"
    if group == LISTED:
        return f"pose {name} of the list (counted from 0) has changed" if name else "the list of poses has changed"
    return None


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _named(found: re.Match[str]) -> str:
    option, value = found[1].replace("-", "_"), found[2]
    known = value in (*ENGINES, *COLOURS)
    return label(option) + ("" if value is None else f" {value.title() if known else value}")
