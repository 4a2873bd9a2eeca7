"""Pictures of the sample case to make films of."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.video import decoder

SIZE_WH = (320, 240)


@pytest.fixture
def decoded_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Films are decoded in this process: a process for each takes longer than its film."""

    def parts(path: Path, *arguments: object) -> Iterator[bytes]:
        return (part for part in decoder.film(path, *arguments) if part)

    monkeypatch.setattr("oneframe.video.film_reader.decoded_apart", parts)


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
