"""A queue rendered at once: what its own command makes of each aligned case."""

from dataclasses import replace

import numpy as np
import pytest

from oneframe.case.case_file import read_case
from oneframe.case.case_queue import NewFrame, add_frames
from oneframe.case.case_writer import write_case
from oneframe.case.pose_record import PoseRecord
from oneframe.dataset.check.check_dataset import check_dataset
from oneframe.errors import InputError
from oneframe.transforms import rigid
from tests.tree import different_files

OPTIONS = ("--workers", "1", "--engine", "raster", "--count", "2")


@pytest.fixture
def queue(write_tiny_case, tmp_path):
    """Two aligned cases, and one without a pose."""
    like = read_case(write_tiny_case(tmp_path / "case"))
    frames = []
    for name in ("a", "b", "c"):
        frames.append(NewFrame(tmp_path / "case" / f"{name}.png"))
        frames[-1].image.write_bytes(like.image.read_bytes())
    for number, path in enumerate(add_frames(tmp_path / "queue", like, frames)[:2]):
        pose = rigid(np.eye(3), [2.0 * number, 0.0, 0.0]) @ like.cam_from_mesh
        aligned = replace(
            read_case(path, posed=False), posed=True, cam_from_mesh=pose, alignment=PoseRecord(method="refined")
        )
        write_case(path, aligned)
    return tmp_path / "queue"


@pytest.mark.render
def test_a_queue_is_its_aligned_cases(queue, tmp_path, run_oneframe):
    path = queue / "b" / "case.toml"
    text = path.read_text()
    for change in (("size = [", "size = [1"), ("../../case/b.png", "../../case/missing.png")):
        path.write_text(text.replace(*change))
        ended = run_oneframe("render", queue, "--out", tmp_path / "out", *OPTIONS)
        assert ended.returncode == 2
        assert ended.stderr.startswith("error: b: "), ended.stderr
        # all cases are read before anything is rendered
        assert not (tmp_path / "out").exists()
    path.write_text(text)
    ended = run_oneframe("render", queue, "--out", tmp_path / "out", *OPTIONS)
    assert ended.returncode == 0, ended.stderr
    assert "c: left out, it is new" in ended.stdout
    assert sorted(each.name for each in (tmp_path / "out" / "cases").iterdir()) == ["a", "b"]
    alone = run_oneframe("render", path, "--out", tmp_path / "alone", *OPTIONS)
    assert alone.returncode == 0, alone.stderr
    assert different_files(tmp_path / "out" / "cases" / "b", tmp_path / "alone") == []
    with pytest.raises(InputError, match="give one of the datasets of this queue"):
        check_dataset(tmp_path / "out")
