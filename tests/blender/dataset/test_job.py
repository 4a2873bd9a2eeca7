"""A dataset as one run writes it, the same however the work is divided; and what options give."""

import dataclasses
import hashlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.blender.dataset.job import Job, open_job
from oneframe.case.case_file import read_case
from oneframe.dataset.check.check_dataset import check_dataset
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.option_arguments import option_arguments
from oneframe.dataset.run.resume_record import read_record
from oneframe.dataset.run.run_folder import Shard
from oneframe.errors import RunError
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector
from tests.blender.dataset.job_runs import (
    ARGUMENTS,
    OPTIONS,
    VIEWS,
    WHOLE,
    assert_same_dataset,
    finished_views,
    read_rgb,
    run_here,
    times,
)
from tests.tree import tree

pytestmark = pytest.mark.render


def test_all_files_of_the_layout_are_there(reference):
    kinds = ("rgb", "depth", "mask", "mask_visib", "mask_observed", "depth_mm", "frame")
    views = {ViewPaths(reference, index).relative(kind) for index in range(VIEWS) for kind in kinds}
    scene = {f"train_synt/000000/scene_{name}.json" for name in ("camera", "gt", "gt_info", "gt_coco_modal")}
    models = {f"{name}/{file}" for name in ("models", "models_eval") for file in ("models_info.json", "obj_000001.ply")}
    tables = {
        "camera.json",
        "dataset.json",
        "checksums.json",
        "poses.csv",
        "transforms.json",
        "contact_sheet.png",
        "overlay.png",
        "test_targets_bop19.json",
        "dataset_info.md",
    }
    assert tree(reference).keys() == views | scene | models | tables
    assert json.loads((reference / "dataset.json").read_text())["count"] == VIEWS
    sheet = cv2.imread(str(reference / "contact_sheet.png"))
    # 24 views in rows of 6, 4 px apart
    assert sheet.shape == (4 * (48 + 4) + 4, 6 * (64 + 4) + 4, 3)
    first = cv2.imread(str(ViewPaths(reference, 0).file("rgb")))
    assert np.array_equal(sheet[4:52, 4:68], first)


def test_raster_makes_the_same_dataset_in_any_processes(case, tmp_path, run_command):
    """Also in those of the program, which have other threads, and other views before."""
    options = dataclasses.replace(OPTIONS, count=8, engine="raster", samples=4, occluders=2.0)
    run_here(case, tmp_path / "one", options)
    arguments = (*option_arguments(options), "--workers", 2)
    program = [sys.executable, "-m", "oneframe.commands", "render", case, "--out", tmp_path / "two", *arguments]
    ended = run_command([*map(str, program)])
    assert (ended.returncode, ended.stderr) == (0, "")
    assert_same_dataset(tmp_path / "two", tmp_path / "one")


def test_shards_in_one_folder_make_the_same_dataset(case, reference, tmp_path, render_command):
    """The last two are made at the same time."""
    out = tmp_path / "out"
    assert "shard 2/3: 10 views are finished" in run_here(case, out, shard=Shard(2, 3))
    parts = [render_command(case, "--out", out, *ARGUMENTS, "--workers", 1, "--shard", f"{i}/3") for i in range(2)]
    processes = [subprocess.Popen(part, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) for part in parts]
    assert [process.communicate()[1] for process in processes] == [b"", b""]
    assert [process.returncode for process in processes] == [0, 0]
    run_here(case, out)
    assert_same_dataset(out, reference)


def test_a_shard_of_another_run_is_not_merged(case, tmp_path):
    """Copied together, the description of the last one hides that of the other; the records tell all the same."""
    options = dataclasses.replace(OPTIONS, count=4)
    other = dataclasses.replace(options, seed=4)
    for index, its in ((0, options), (1, other)):
        run_here(case, tmp_path / f"part {index}", its, Shard(index, 2))
    for last, message in [
        (0, r"views of another run are among those of dataset\.json: 2-3; .*frame/000002\.json"),
        (1, r"holds the dataset of another run \(options\.seed was 4, is 3\)"),
    ]:
        out = tmp_path / f"merged {last}"
        for index in (1 - last, last):
            shutil.copytree(tmp_path / f"part {index}", out, dirs_exist_ok=True)
        before = tree(out)
        with pytest.raises(RunError, match=message):
            run_here(case, out, options)
        assert tree(out) | {".work/lock": b""} == before | {".work/lock": b""}
        # what the message advises
        if last == 0:
            for index in (2, 3):
                ViewPaths(out, index).file("frame").unlink()
            run_here(case, out, options)
    run_here(case, tmp_path / "whole", options)
    assert_same_dataset(tmp_path / "merged 0", tmp_path / "whole")


def test_the_hashes_of_inputs_are_those_of_the_bytes_that_were_used(tmp_path, write_tiny_case):
    """A file that is saved while a run starts is not taken for the one that it used."""
    case = read_case(write_tiny_case(tmp_path / "case"))
    np.save(tmp_path / "poses.npy", case.cam_from_mesh[None])
    inputs = {"frame": case.image, "surface": case.mesh, "poses": tmp_path / "poses.npy"}
    expected = {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in inputs.items()}
    options = dataclasses.replace(OPTIONS, poses=str(tmp_path / "poses.npy"))
    opened = open_job(Job(case, tmp_path / "out", options, WHOLE))
    for path in inputs.values():
        path.write_bytes(b"saved again")
    assert opened.inputs_sha256 == expected
    # of the poses themselves there is a hash of its own
    assert opened.description["inputs_sha256"] == {name: expected[name] for name in ("frame", "surface")}


def test_explicit_poses_are_for_the_mesh_files_frame_and_replace_the_count(case, tmp_path):
    cam_from_mesh = read_case(case).cam_from_mesh
    poses = np.stack([rigid(rotation_from_vector(np.array([0, 0, angle]))) @ cam_from_mesh for angle in (0, 0.2, 3)])
    np.save(tmp_path / "poses.npy", poses)
    options = dataclasses.replace(OPTIONS, count=100, poses=str(tmp_path / "poses.npy"))
    run_here(case, tmp_path / "out", options)
    records = [read_record(ViewPaths(tmp_path / "out", index)) for index in range(3)]
    assert finished_views(tmp_path / "out") == 3
    mesh_from_model = np.array(json.loads((tmp_path / "out/dataset.json").read_text())["mesh_from_model"])
    assert np.allclose(mesh_from_model[:3, 3], [12, -7, 40], atol=0.1)
    found = np.stack([record.cam_from_model @ inverse_rigid(mesh_from_model) for record in records])
    assert np.allclose(found, poses, atol=1e-9)
    # at the frame's own pose, the view is the frame
    view, frame = (read_rgb(path) for path in (ViewPaths(tmp_path / "out", 0).file("rgb"), case.parent / "frame.png"))
    observed = cv2.imread(str(ViewPaths(tmp_path / "out", 0).file("mask_observed")), cv2.IMREAD_GRAYSCALE) > 0
    assert observed.mean() > 0.8
    assert np.abs(view - frame)[observed].max() <= 1
    # other poses are another dataset
    for changed in (poses[::-1], np.stack([*poses[:2], poses[0]])):
        np.save(tmp_path / "poses.npy", changed)
        with pytest.raises(RunError, match="a pose of the list has changed, which may"):
            run_here(case, tmp_path / "out", options)


def test_a_list_of_poses_grows_at_its_end(case, tmp_path):
    middle = read_case(case).cam_from_mesh
    poses = np.stack([rigid(rotation_from_vector(np.array([0, 0, 0.1 * turn]))) @ middle for turn in range(6)])
    out, whole, file = tmp_path / "out", tmp_path / "whole", tmp_path / "poses.npy"
    options = dataclasses.replace(OPTIONS, poses=str(file))

    def run_list(folder: Path, listed: np.ndarray, shard: Shard = WHOLE) -> str:
        np.save(file, listed)
        return run_here(case, folder, options, shard)

    run_list(out, poses[:4])
    before = times(out)
    # the same poses in another file
    (tmp_path / "poses.json").write_text(json.dumps(poses[:4].tolist()))
    run_here(case, out, dataclasses.replace(options, poses=str(tmp_path / "poses.json")))
    assert {name: when for name, when in times(out).items() if name != "."} == {
        name: when for name, when in before.items() if name != "."
    }
    run_list(out, poses)
    run_list(whole, poses)
    assert_same_dataset(out, whole)
    assert all(times(out)[name] == before[name] for name in before if name.count("/") == 3)
    assert not check_dataset(out, case=read_case(case), poses=file).findings
    with pytest.raises(RunError, match="holds a dataset of 6 views, and 5 are wanted"):
        run_list(out, poses[:5])
    farther = rigid(translation=[0, 0, 5000]) @ middle
    with pytest.raises(
        RunError, match=r"listed poses .* set the scale of the depth images, which was 0.01 mm, is 0.1 mm"
    ):
        run_list(out, np.stack([*poses, farther]))
    with pytest.raises(
        RunError, match=r"listed poses .* set the scale of the depth images, which was 0.01 mm, is null mm; null: drawn"
    ):
        run_here(case, out, OPTIONS)
    # a shard of another list
    other = poses.copy()
    other[4] = poses[0]
    for name, listed, index in (("other", other, 1), ("short", poses[:4], 0)):
        run_list(tmp_path / name, listed, Shard(index, 2))
        shutil.copytree(tmp_path / name, tmp_path / "differs", dirs_exist_ok=True)
    with pytest.raises(RunError, match="views of other poses than the listed ones are in the folder: 4"):
        run_list(tmp_path / "differs", poses)
