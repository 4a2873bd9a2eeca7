"""A dataset that is complete: left as it is, repaired, grown, and given a video later."""

import dataclasses
import io
import shutil
from pathlib import Path

import numpy as np
import pytest

from oneframe.blender.dataset import run as dataset_run
from oneframe.blender.dataset.job import Job, OpenJob, open_job
from oneframe.blender.render.video import write_video
from oneframe.case.case_file import read_case
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.run_folder import Shard
from oneframe.errors import RunError
from oneframe.transforms import rigid
from oneframe.video.film_reader import WIDEST, Film, read_video_frame
from tests.blender.dataset.job_runs import OPTIONS, VIEWS, WHOLE, assert_same_dataset, run_here, times
from tests.tree import tree

pytestmark = pytest.mark.render


def test_a_complete_dataset_is_left_as_it_is_without_any_preparation(case, reference, monkeypatch):
    monkeypatch.setattr(OpenJob, "renderer", lambda *_, **__: pytest.fail("prepared to render"))
    before = times(reference)
    messages = run_here(case, reference)
    assert messages.splitlines()[-1] == f"dataset of {VIEWS} views: {reference}"
    assert {name: when for name, when in times(reference).items() if name != "."} == before
    assert not (reference / ".work").exists()


def test_what_is_lost_or_damaged_is_written_again_and_reported(case, tmp_path):
    """Every file of a dataset in turn, in every way that a loss of power or a careless user leaves it."""
    options = dataclasses.replace(OPTIONS, count=2, video=True, video_frames=3)
    whole, out = tmp_path / "whole", tmp_path / "out"
    run_here(case, whole, options)
    shutil.copytree(whole, out)
    harms = [
        lambda path: path.unlink(),
        lambda path: path.write_bytes(path.read_bytes()[:-7]),
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(bytes(len(path.read_bytes()) + 3)),
        lambda path: path.write_bytes(b"[" * 30_000),
    ]
    names = sorted(tree(whole).keys() - {"dataset.json"})
    groups = [names[start::7] for start in range(7)]
    for number, group in enumerate(groups):
        for place, name in enumerate(group):
            harms[(number + place) % len(harms)](out / name)
        views = {int(name.rpartition("/")[2][:6]) for name in group if name.count("/") == 3}
        # one without a record has never been finished
        views = {view for view in views if ViewPaths(out, view).file("frame").exists()}
        reported = f"{len(views)} finished views are no longer whole and are rendered again"
        assert (reported in run_here(case, out, options)) == bool(views)
        assert_same_dataset(out, whole)
        if "video/trajectory.mp4" in group:
            check_video(case, out / "video", options)
    # what keeps its size is found by its hash
    (out / "dataset.json").write_text((out / "dataset.json").read_text().replace("\n", "\t"))
    for name in ("models/obj_000001.ply", ViewPaths(out, 1).relative("rgb"), "video/trajectory.mp4"):
        data = bytearray((out / name).read_bytes())
        data[len(data) // 2] ^= 1
        (out / name).write_bytes(data)
    run_here(case, out, options)
    assert tree(out) != tree(whole)
    stream = io.StringIO()
    job = Job(read_case(case), out, options, WHOLE)
    dataset_run.run(job, workers=1, worker_command=(), stream=stream, verify=True)
    assert "1 finished views are no longer whole and are rendered again: 1 (" in stream.getvalue()
    assert "2 files of the dataset are no longer whole and are written again" in stream.getvalue()
    assert_same_dataset(out, whole)


def test_a_dataset_grows_to_what_it_would_have_been(case, reference, tmp_path):
    out, few = tmp_path / "out", dataclasses.replace(OPTIONS, count=6)
    run_here(case, out, few)
    before = times(out)
    for index in range(2):
        run_here(case, out, OPTIONS, Shard(index, 2))
    run_here(case, out)
    assert_same_dataset(out, reference)
    assert all(times(out)[name] == before[name] for name in before if name.count("/") == 3)
    before = times(out)
    with pytest.raises(RunError, match="holds a dataset of 30 views, and 6 are wanted: a dataset may grow, but no"):
        run_here(case, out, few)
    assert times(out) == before


def test_poses_along_a_trajectory_do_not_grow(case, tmp_path, monkeypatch):
    few = dataclasses.replace(OPTIONS, count=3, sampler="trajectory")
    run_here(case, tmp_path / "out", few)
    monkeypatch.setattr(OpenJob, "renderer", lambda *_, **__: pytest.fail("prepared to render"))
    before = times(tmp_path)
    with pytest.raises(RunError, match="poses along a trajectory depend on the number of views"):
        run_here(case, tmp_path / "out", dataclasses.replace(few, count=4))
    assert times(tmp_path) == before


def test_a_video_is_added_later_and_once(case, reference, tmp_path):
    out = shutil.copytree(reference, tmp_path / "out")
    before = times(out)
    options = dataclasses.replace(OPTIONS, video=True, video_frames=6)
    assert "video: " in run_here(case, out, options)
    after = times(out)
    assert {name for name in after if name not in before} == {"video", "video/trajectory.mp4", "video/poses.csv"}
    assert [name for name in before if after[name] != before[name]] == ["checksums.json"]
    check_video(case, out / "video", options)

    assert "video: " not in run_here(case, out, options)
    assert times(out) == after
    # one of another length replaces it
    options = dataclasses.replace(options, video_frames=4)
    assert "video: " in run_here(case, out, options)
    check_video(case, out / "video", options)
    # the dataset without a video is the same one
    assert "video: " not in run_here(case, out)


def check_video(case: Path, folder: Path, options: DatasetOptions) -> None:
    rows = np.loadtxt(folder / "poses.csv", delimiter=",", skiprows=1)
    assert rows[:, 0].tolist() == list(range(options.video_frames))
    assert np.allclose(rows[:, 1], rows[:, 0] / 24)
    with Film(folder / "trajectory.mp4", width=WIDEST) as film:
        assert film.info.fps == 24
        frames = [frame.image.astype(float) for frame in film]
    assert len(frames) == options.video_frames
    with open_job(Job(read_case(case), folder, options, WHOLE)).renderer(threads=1) as renderer:
        for frame, row in zip(frames, rows, strict=True):
            view = renderer.render(rigid(row[2:11].reshape(3, 3), row[11:14])).rgb * 255
            assert frame.shape == view.shape
            # of colours, MPEG keeps a quarter of the pixels
            assert np.abs(frame - view).mean() < 8
            assert np.abs((frame - view) @ [0.2126, 0.7152, 0.0722]).mean() < 5


def test_videos_of_odd_size_get_even_sides(tmp_path):
    image = np.full((49, 65, 3), [0.2, 0.5, 0.8])
    write_video(tmp_path / "v.mp4", [image, image])
    frame = read_video_frame(tmp_path / "v.mp4", 1)
    assert frame.shape == (50, 66, 3)
    assert np.abs(frame - np.array([51, 127.5, 204])).max() < 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["v.mp4"]
