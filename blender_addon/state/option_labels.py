"""What the window calls the options of a dataset."""

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
    "unseen": "Unseen Surface",
    "max_incidence_deg": "Incidence (°)",
    "scale": "Image Size (×)",
    "float_depth": "Float Depth",
    "video": "Video",
    "video_frames": "Video Frames",
}
"""Labels that are not the option's own name."""


def label(option: str) -> str:
    """The label of an option in the window."""
    return LABELS.get(option) or option.replace("_", " ").title()
