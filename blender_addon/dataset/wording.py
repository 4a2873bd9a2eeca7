"""Messages of the command line in the words of the window: labels of the panel instead of options."""

import re

LABELS = {
    "count": "Views",
    "cone_deg": "Max Tilt (°)",
    "roll_deg": "Max Roll (°)",
    "distance_min": "Nearest (×)",
    "distance_max": "Farthest (×)",
    "shift_mm": "Max Shift (mm)",
    "sigma_deg": "Rotation σ (°)",
    "sigma_mm": "Translation σ (mm)",
    "polar_deg": "Max Angle (°)",
    "min_observed": "Min Observed",
    "min_surface": "Min Surface",
    "min_clearance_mm": "Clearance (mm)",
    "sampler": "Poses",
    "samples": "Rays at Edges",
    "scale": "Image Size (×)",
    "float_depth": "Float Depth",
    "video": "Video",
    "video_frames": "Video Frames",
}
"""Labels of the dataset's options in the panel."""

_SENTENCES = (
    (" (--out)", ""),
    ("run the same command again", "press Render Dataset again"),
    ("start the run again", "press Render Dataset again"),
)


def label(option: str) -> str:
    """The label of an option in the panel."""
    return LABELS.get(option) or option.replace("_", " ").title()


def in_window_words(message: str) -> str:
    """A message of the pipeline for the window: ``--engine cycles`` becomes ``Engine Cycles``."""
    for words, own in _SENTENCES:
        message = message.replace(words, own)
    return re.sub(r"--([a-z][a-z-]*)(?: ([a-z]+)\b)?", _named, message)


def _named(found: re.Match[str]) -> str:
    option, value = found[1].replace("-", "_"), found[2]
    known = value in ("cycles", "eevee", "workbench", "projective", "texture", "vertex")
    return label(option) + ("" if value is None else f" {value.title() if known else value}")
