"""A dataset to show, and a browser."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.dataset.synthetic_dataset import make_dataset
from tests.report.chromium import PROGRAM, Chromium


@pytest.fixture(scope="package")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset with nothing wrong, made without Blender; not to be changed."""
    root = tmp_path_factory.mktemp("report") / "lumpy views"
    make_dataset(root)
    return root


@pytest.fixture(scope="package")
def browser() -> Iterator[Chromium]:
    if PROGRAM is None:
        pytest.skip("there is no Chromium to open the page in")
    with Chromium() as opened:
        yield opened
