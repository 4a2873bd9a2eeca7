"""A dataset on disk that the tests of its tables share."""

from pathlib import Path

import pytest

from tests.dataset.blank_dataset import write_blank_dataset


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five views in two scenes with their tables; the images are blank, the fourth shows nothing."""
    root = tmp_path_factory.mktemp("dataset")
    write_blank_dataset(root)
    return root
