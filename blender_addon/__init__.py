"""The Blender add-on: align one frame to a surface in the viewport, know how well, colour it, render a dataset.

Operators are thin: they gather from the scene, call one function of the pipeline and report. The build carries the
pipeline inside this package; in a checkout it lies beside it, which is where ``.pipeline`` is then looked for.
"""

from pathlib import Path

_HERE = Path(__file__).resolve().parent
if not (_HERE / "pipeline").is_dir():
    __path__.append(str(_HERE.parent))

from . import (  # noqa: E402  (after the path is known)
    background_job,
    colour,
    dataset,
    estimate,
    landmark_drawing,
    landmark_gestures,
    landmark_tool,
    landmarks,
    loupe,
    move,
    overlay,
    overlay_split,
    panel_colour,
    panel_dataset,
    panel_landmarks,
    panel_pose,
    panel_refine,
    panel_setup,
    panel_view,
    pose_gizmo,
    pose_preview,
    properties,
    refine,
    setup,
    view,
    view_layout,
)

_MODULES = (
    properties,
    setup,
    panel_setup,
    view,
    overlay,
    overlay_split,
    loupe,
    view_layout,
    panel_view,
    move,
    panel_pose,
    pose_gizmo,
    refine,
    panel_refine,
    background_job,
    colour,
    panel_colour,
    pose_preview,
    dataset,
    panel_dataset,
    estimate,
    landmark_gestures,
    landmarks,
    landmark_tool,
    landmark_drawing,
    panel_landmarks,
)


def register() -> None:
    """Called by Blender when the add-on is enabled."""
    for module in _MODULES:
        module.register()


def unregister() -> None:
    """Called by Blender when the add-on is disabled; leaves nothing behind."""
    for module in reversed(_MODULES):
        module.unregister()
