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
    move,
    panel_colour,
    panel_dataset,
    panel_pose,
    panel_setup,
    pose_gizmo,
    pose_preview,
    properties,
    setup,
)

_MODULES = (
    properties,
    setup,
    panel_setup,
    move,
    panel_pose,
    pose_gizmo,
    background_job,
    colour,
    panel_colour,
    pose_preview,
    dataset,
    panel_dataset,
)


def register() -> None:
    """Called by Blender when the add-on is enabled."""
    for module in _MODULES:
        module.register()


def unregister() -> None:
    """Called by Blender when the add-on is disabled; leaves nothing behind."""
    for module in reversed(_MODULES):
        module.unregister()
