"""A dataset to pack, made without Blender; processes see it as the tests do: a thousand views a scene."""

import shutil
from pathlib import Path

import pytest

from oneframe.dataset import layout
from oneframe.packing.pack import PackOptions, pack_dataset
from tests.dataset import synthetic_dataset


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four views of 64 x 48 px with float depth; the last one is cut by the image."""
    root = tmp_path_factory.mktemp("to-pack") / "dataset"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(synthetic_dataset, "PER_SCENE", layout.VIEWS_PER_SCENE)
        synthetic_dataset.make_dataset(root)
    return root


@pytest.fixture(scope="session")
def packed(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """It packed, three views a shard."""
    out = tmp_path_factory.mktemp("packed") / "packed"
    pack_dataset(dataset, out, PackOptions(3))
    return out


@pytest.fixture
def copied(dataset: Path, tmp_path: Path) -> Path:
    """A copy of the dataset for a test to change."""
    return Path(shutil.copytree(dataset, tmp_path / "dataset"))


@pytest.fixture
def copied_pack(packed: Path, tmp_path: Path) -> Path:
    """A copy of the pack for a test to change."""
    return Path(shutil.copytree(packed, tmp_path / "packed"))
