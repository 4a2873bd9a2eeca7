"""A dataset that nobody changed has no findings, whatever it is made of. Damage is for the tests of the check."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oneframe.blender.dataset import run as dataset_run
from oneframe.blender.dataset.job import Job
from oneframe.case.case_file import read_case
from oneframe.dataset.check.check_dataset import check_dataset
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.run_folder import Shard
from oneframe.errors import InputError

pytestmark = pytest.mark.render

OPTIONS = DatasetOptions(count=6, seed=3, float_depth=True)
UNTOUCHED = {
    "cycles": replace(OPTIONS, colour="vertex", sampler="trajectory", samples=4, points=True),
    "eevee": replace(OPTIONS, engine="eevee", count=2),
    "raster": replace(OPTIONS, engine="raster", colour="vertex", unseen="fill", samples=4, normals=True, points=True),
    "video": replace(OPTIONS, engine="raster", video=True, video_frames=8),
}


def render(case: Path, out: Path, options: DatasetOptions) -> Path:
    job = Job(read_case(case), out, options, Shard())
    dataset_run.run(job, workers=1, worker_command=(), stream=io.StringIO())
    return out


@pytest.fixture(scope="module")
def case(tmp_path_factory, write_tiny_case) -> Path:
    return write_tiny_case(tmp_path_factory.mktemp("case"))


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.gl] * (name == "eevee")) for name in UNTOUCHED])
def test_no_kind_of_dataset_raises_a_false_alarm(case, tmp_path, name):
    report = check_dataset(render(case, tmp_path / "out", UNTOUCHED[name]), case=read_case(case), stream=io.StringIO())
    assert not report.findings, report.findings.shown()


def test_listed_poses_raise_no_false_alarm(case, tmp_path):
    """The same pose twice is no copy if the user listed it twice."""
    pose = np.array([[1.0, 0, 0, -12], [0, -1, 0, -7], [0, 0, -1, 340], [0, 0, 0, 1]])
    np.save(tmp_path / "poses.npy", np.stack([pose, pose]))
    listed = render(case, tmp_path / "listed", replace(OPTIONS, poses=str(tmp_path / "poses.npy")))
    report = check_dataset(listed, case=read_case(case), poses=tmp_path / "poses.npy", stream=io.StringIO())
    assert not report.findings, report.findings.shown()
    with pytest.raises(InputError, match="give it with --poses"):
        check_dataset(listed, case=read_case(case), stream=io.StringIO())
