"""The tiny case, opened; films are decoded in the test's process, as in tests/video."""

from pathlib import Path

import numpy as np
import pytest

from tests.video.conftest import decoded_here  # noqa: F401


@pytest.fixture(autouse=True)
def films_decoded_here(decoded_here):  # noqa: F811
    """A process for each film takes longer than its frames."""


@pytest.fixture
def case_path(write_tiny_case, tmp_path) -> Path:
    return write_tiny_case(tmp_path / "case")


@pytest.fixture
def folder(write_tiny_case, tmp_path) -> Path:
    """Its folder, with nothing above it."""
    return write_tiny_case(tmp_path).parent


@pytest.fixture
def opened(addon, case_path):
    """The scene of the case."""
    import bpy

    bpy.ops.oneframe.open_case(filepath=str(case_path))
    return bpy.context.scene


@pytest.fixture
def in_view(addon):
    """The 3D view, looking through the scene's camera, as the context."""
    import bpy

    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    area.spaces.active.region_3d.view_perspective = "CAMERA"
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        yield area.spaces.active


def pin(scene, point, pixel):
    """Pull a new pin from a surface point, model frame, mm, to a pixel, as a drag does."""
    from blender_addon.landmarks import edit, solve
    from blender_addon.state import events, from_scene

    pose, index = from_scene.cam_from_model(scene), edit.add(scene)
    with events.muted():
        edit.set_halves(scene, index, point_model=point, pixel=pixel)
    solve.pull(scene, pose, index)
    events.landmarks_changed(scene)


def refused(operator, message, *arguments, **settings):
    """Call an operator, which is to report this message."""
    with pytest.raises(RuntimeError, match=message):
        operator(*arguments, **settings)


def pixels_of(image):
    """``(H, W, 3)`` codes 0..255 of a Blender image, top row first."""
    width, height = image.size
    values = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    return 255 * values.reshape(height, width, -1)[::-1, :, :3]
