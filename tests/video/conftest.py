"""Pictures of the sample case to make films of."""

import cv2
import numpy as np
import pytest

SIZE_WH = (320, 240)


@pytest.fixture(scope="session")
def sample_views(tmp_path_factory: pytest.TempPathFactory) -> list[np.ndarray]:
    """Two photographs of the sample case, (240, 320, 3) uint8 RGB."""
    pytest.importorskip("bpy")
    from oneframe.blender.sample.photograph import take_photographs
    from oneframe.sample.temporal_bone import MICROSCOPE, frame_pose, held_out_poses, sample_surface

    folder = tmp_path_factory.mktemp("views")
    poses = (frame_pose(), held_out_poses()[3])
    shots = [(pose, folder / f"{number}.png") for number, pose in enumerate(poses)]
    surface = sample_surface(spacing_mm=0.8)
    paths = list(take_photographs(surface, MICROSCOPE.resized(*SIZE_WH), shots))
    return [np.ascontiguousarray(cv2.imread(str(path))[..., ::-1]) for path in paths]
