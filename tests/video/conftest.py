"""Pictures of the sample case to make films of, and a writer of films."""

from collections.abc import Callable, Iterable
from pathlib import Path

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


@pytest.fixture(scope="session")
def write_film() -> Callable[..., Path]:
    """Writes RGB images of one size as a video and gives its path; without loss by default."""

    def write(path: Path, images: Iterable[np.ndarray], fourcc: str = "FFV1", fps: float = 25.0) -> Path:
        writer = None
        for image in images:
            if writer is None:
                size = (image.shape[1], image.shape[0])
                writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*fourcc), fps, size)
                if not writer.isOpened():
                    pytest.skip(f"this OpenCV writes no {fourcc}")
            writer.write(np.ascontiguousarray(image[..., ::-1]))
        writer.release()
        return path

    return write
