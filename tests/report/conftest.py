"""A dataset and an evaluation to show, and a browser."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.dataset.synthetic_dataset import make_dataset
from tests.report.chromium import PROGRAM, Chromium
from tests.report.synthetic_evaluation import write_evaluation


@pytest.fixture(scope="package")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset with nothing wrong, made without Blender; not to be changed."""
    root = tmp_path_factory.mktemp("report") / "lumpy views"
    make_dataset(root)
    return root


@pytest.fixture(scope="package")
def evaluation(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An evaluation; not to be changed."""
    return write_evaluation(tmp_path_factory.mktemp("report") / "evaluation", np.random.default_rng(3))


@pytest.fixture(scope="package")
def browser() -> Iterator[Chromium]:
    if PROGRAM is None:
        pytest.skip("there is no Chromium to open the page in")
    with Chromium() as opened:
        yield opened
