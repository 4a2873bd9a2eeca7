"""A tiny case and its dataset, which the tests of this folder share."""

from pathlib import Path

import pytest

from tests.blender.dataset.job_runs import VIEWS, run_here


@pytest.fixture(scope="module")
def case(tmp_path_factory, write_tiny_case) -> Path:
    return write_tiny_case(tmp_path_factory.mktemp("case"))


@pytest.fixture(scope="module")
def reference(case, tmp_path_factory) -> Path:
    """The dataset, made by one process in one go."""
    out = tmp_path_factory.mktemp("reference") / "out"
    assert f"{VIEWS}/{VIEWS} views, " in run_here(case, out)
    return out
