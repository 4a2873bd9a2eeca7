"""Runs of a small dataset in this process, for the tests of this folder."""

import io
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.blender.dataset import run as dataset_run
from oneframe.blender.dataset.job import Job
from oneframe.case.case_file import read_case
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.run_folder import Shard
from tests.tree import tree

VIEWS = 30
OPTIONS = DatasetOptions(count=VIEWS, seed=3, float_depth=True)
WHOLE = Shard()
ARGUMENTS = ("--count", VIEWS, "--seed", 3, "--float-depth")
linux_only = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc")


def run_here(case: Path, out: Path, options: DatasetOptions = OPTIONS, shard: Shard = WHOLE) -> str:
    """Do a job in this process, without workers; returns the output."""
    stream = io.StringIO()
    dataset_run.run(Job(read_case(case), out, options, shard), workers=1, worker_command=(), stream=stream)
    return stream.getvalue()


def times(folder: Path) -> dict[str, int]:
    return {path.relative_to(folder).as_posix(): path.stat().st_mtime_ns for path in folder.rglob("*")}


def assert_same_dataset(out: Path, reference: Path) -> None:
    """Byte for byte, and no other files (.work, .partial-*)."""
    found, expected = tree(out), tree(reference)
    assert sorted(found) == sorted(expected)
    assert [name for name in expected if found[name] != expected[name]] == []
    assert times(out).keys() == times(reference).keys()


def finished_views(out: Path) -> int:
    return sum(1 for _ in out.glob("train_synt/*/frame/*.json"))


def read_rgb(path: Path) -> np.ndarray:
    return cv2.imread(str(path))[..., ::-1].astype(float)
