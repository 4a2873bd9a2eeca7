"""Datasets on disk that the tests of tables and of the check share."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from oneframe.dataset import layout
from tests.dataset.synthetic_dataset import PER_SCENE, make_dataset, write_sums, write_video


@pytest.fixture(scope="module")
def small_scenes() -> Iterator[None]:
    """Few views a scene, so that a small dataset has several."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(layout, "VIEWS_PER_SCENE", PER_SCENE)
        yield


@pytest.fixture(scope="session")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset with nothing wrong, made without Blender, and without a video: a process decodes that."""
    root = tmp_path_factory.mktemp("sound") / "dataset"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(layout, "VIEWS_PER_SCENE", PER_SCENE)
        make_dataset(root, video=False)
    return root


@pytest.fixture
def copied(sound: Path, tmp_path: Path) -> Path:
    """A copy of it for a test to change."""
    return Path(shutil.copytree(sound, tmp_path / "dataset"))


@pytest.fixture
def filmed(copied: Path) -> Path:
    """Such a copy with a video."""
    write_video(copied / "video")
    write_sums(copied)
    return copied
