"""Dataset runs as a user has them: the same files however the work is divided, stopped, killed or refused."""

import dataclasses
import hashlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.blender.dataset import run as dataset_run
from oneframe.blender.dataset.job import Job, OpenJob, open_job
from oneframe.blender.render.video import _is_whole, write_video
from oneframe.case.case_file import read_case
from oneframe.dataset import layout as dataset
from oneframe.dataset.check.check_dataset import check_dataset
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run import run_folder
from oneframe.dataset.run.resume_record import read_record
from oneframe.dataset.run.run_folder import Shard
from oneframe.errors import RunError
from oneframe.images.png import encode_png
from oneframe.progress import read_progress
from oneframe.reader import open_dataset
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector
from oneframe.video.film_reader import WIDEST, Film, read_video_frame
from tests.tree import tree
from tests.waiting import children, wait_until

pytestmark = pytest.mark.render

VIEWS = 30
OPTIONS = DatasetOptions(count=VIEWS, seed=3, float_depth=True)
WHOLE = Shard()
ARGUMENTS = ("--count", VIEWS, "--seed", 3, "--float-depth")
linux_only = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc")


@pytest.fixture(scope="module")
def case(tmp_path_factory, write_tiny_case) -> Path:
    return write_tiny_case(tmp_path_factory.mktemp("case"))


@pytest.fixture(scope="module")
def reference(case, tmp_path_factory) -> Path:
    """The dataset, made by one process in one go."""
    out = tmp_path_factory.mktemp("reference") / "out"
    assert f"{VIEWS}/{VIEWS} views, " in run_here(case, out)
    return out


def run_here(case: Path, out: Path, options: DatasetOptions = OPTIONS, shard: Shard = WHOLE) -> str:
    """The same in this process, without workers; returns the output."""
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


def test_all_files_of_the_layout_are_there(reference):
    kinds = ("rgb", "depth", "mask", "mask_visib", "mask_observed", "depth_mm", "frame")
    views = {ViewPaths(reference, index).relative(kind) for index in range(VIEWS) for kind in kinds}
    scene = {f"train_synt/000000/scene_{name}.json" for name in ("camera", "gt", "gt_info", "gt_coco")}
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


def test_flow_warps_the_colours_of_one_view_onto_another(reference):
    views = open_dataset(reference)
    for one, other in ((views[0], views[1]), (views[5], views[2])):
        flow_px, visible = one.flow_to(other)
        there = (flow_px + np.stack(np.meshgrid(*map(np.arange, one.mask.shape[::-1])), -1)).astype(np.float32)
        shown = cv2.remap(other.observed.astype(np.float32), there, None, cv2.INTER_LINEAR) == 1
        warped = cv2.remap(other.rgb, there, None, cv2.INTER_LINEAR)
        off = np.abs(warped.astype(float) - one.rgb)[visible & shown & one.observed].max(axis=1)
        assert len(off) > 500
        assert np.quantile(off, 0.5) <= 3
        assert np.quantile(off, 0.98) <= 10


def test_raster_makes_the_same_dataset_in_any_processes(case, tmp_path, run_command):
    """Also in those of the program, where Embree has other threads, and other views before."""
    options = dataclasses.replace(OPTIONS, count=8, engine="raster", samples=4)
    run_here(case, tmp_path / "one", options)
    arguments = ("--count", 8, "--seed", 3, "--float-depth", "--engine", "raster", "--samples", 4, "--workers", 2)
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


def test_shards_write_the_tables_of_their_own_scenes(case, tmp_path, monkeypatch):
    monkeypatch.setattr(dataset, "VIEWS_PER_SCENE", 4)
    options = dataclasses.replace(OPTIONS, count=10)
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    run_here(case, whole, options)
    run_here(case, parts, options, Shard(0, 2))
    scenes = [parts / "train_synt" / f"{scene:06d}" / "scene_gt.json" for scene in range(3)]
    assert [scene.exists() for scene in scenes] == [True, False, False]
    run_here(case, parts, options, Shard(1, 2))
    assert_same_dataset(parts, whole)
    assert [len(json.loads(scene.read_text())) for scene in scenes] == [4, 4, 2]


# --- killed, stopped, refused ---------------------------------------------------------------------------------------


@pytest.fixture
def start() -> Iterator:
    """Starts a command in a new session, and ends its remaining processes after the test."""
    started: list[subprocess.Popen] = []

    def begin(command: list[str]) -> subprocess.Popen:
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        started.append(process)
        return process

    yield begin
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@linux_only
def test_one_writer_at_a_time_and_no_need_of_workers(
    case, reference, tmp_path, render_command, run_oneframe, start, monkeypatch
):
    monkeypatch.setattr(run_folder, "SHARDS_SECONDS", 0.1)
    out = tmp_path / "out"
    command = render_command(case, "--out", out, *ARGUMENTS, "--workers", 2)
    process = start(command)
    wait_until(lambda: finished_views(out) > 0 and children(process.pid), process)
    # while it stands still, it cannot end too early for this test
    os.kill(process.pid, signal.SIGSTOP)
    assert process.poll() is None
    # a worker may go on, and rename the file that it is writing
    before = {name: content for name, content in tree(out).items() if "/.partial-" not in name}
    for more in ((), ("--shard", "0/2")):
        ended = run_oneframe("render", case, "--out", out, *ARGUMENTS, *more)
        assert ended.returncode == 3
        assert ended.stderr == (
            f"error: {out}: another process renders into this folder; wait for it, stop it, or choose another folder "
            "(--out)\n"
        )
    # what a worker finishes in the meantime may be new
    assert before.items() <= tree(out).items()
    (worker,) = children(process.pid)
    os.kill(worker, signal.SIGKILL)
    os.kill(process.pid, signal.SIGCONT)
    _, errors = process.communicate()
    assert process.returncode == 0
    assert errors == "worker 1 was killed by signal 9; the others continue\n"
    assert_same_dataset(out, reference)


STRUCTURE = '[[structures]]\nname = "nerve"\nmesh = "surface.ply"\n'
CHANGES = {
    "the camera": (
        lambda folder, _: edit(folder / "case.toml", "320.0", "321.0"),
        "fx of the camera was 320.0, is 321.0",
    ),
    "the pose": (lambda folder, _: edit(folder / "case.toml", "340", "341"), "the pose has changed"),
    "a structure": (
        lambda folder, _: edit(folder / "case.toml", "[pose]", STRUCTURE + "[pose]"),
        "the file of the structure nerve",
    ),
    "the frame": (
        lambda folder, _: (folder / "frame.png").write_bytes(encode_png(np.zeros((48, 64, 3), np.uint8))),
        "the file of the frame has changed",
    ),
    "the mesh": (lambda folder, _: edit(folder / "surface.ply", "end_header", "comment \nend_header"), "the surface"),
    "the seed": (lambda _, options: dataclasses.replace(options, seed=4), "options.seed was 3, is 4"),
}


def edit(path: Path, old: str, new: str) -> None:
    data = path.read_bytes()
    assert data.count(old.encode()) == 1
    path.write_bytes(data.replace(old.encode(), new.encode()))


@pytest.mark.parametrize("what", CHANGES)
def test_another_dataset_does_not_get_into_the_folder(case, reference, tmp_path, what):
    change, message = CHANGES[what]
    other = shutil.copytree(case.parent, tmp_path / "case")
    before = times(reference)
    options = change(other, OPTIONS)
    options = options if isinstance(options, DatasetOptions) else OPTIONS
    with pytest.raises(RunError, match="holds the dataset of another run") as refused:
        run_here(other / "case.toml", reference, options)
    assert message in str(refused.value)
    assert times(reference) == before


def test_a_case_saved_again_with_the_same_meaning_resumes(case, reference, tmp_path):
    other, out = shutil.copytree(case.parent, tmp_path / "case"), shutil.copytree(reference, tmp_path / "out")
    edit(other / "case.toml", "[pose]", "# aligned by eye\n[pose]")
    shutil.rmtree(ViewPaths(out, 7).file("frame").parent)
    run_here(other / "case.toml", out)
    assert_same_dataset(out, reference)


def test_workers_refuse_inputs_that_changed_after_the_run_began(case, reference, tmp_path, render_command):
    other, out = shutil.copytree(case.parent, tmp_path / "case"), shutil.copytree(reference, tmp_path / "out")
    edit(other / "case.toml", "340", "341")
    command = render_command(other / "case.toml", "--out", out, *ARGUMENTS, "--worker")
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as worker:
        # its input stays open: it ends by itself
        assert b"the pose has changed" in worker.stderr.read()
        assert worker.wait() == 3


def test_a_run_ends_with_its_input(case, tmp_path, render_command):
    out, views = tmp_path / "out", 10 * VIEWS
    running = subprocess.Popen(
        render_command(
            case, "--out", out, "--count", views, "--workers", 2, "--end-with-input", "--progress-seconds", "0.1"
        ),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    messages = filter(None, map(read_progress, running.stdout))
    counts = [next(messages).count, next(messages).count]
    # what the system does when the program that started it dies
    running.stdin.close()
    assert running.wait() == 130
    assert "run the same command again to continue" in running.stderr.read()
    assert counts == sorted(counts)
    assert 0 < finished_views(out) < views


@pytest.fixture
def small_disk(tmp_path) -> Iterator[Path]:
    """A file system with room for a few views."""
    disk = tmp_path / "disk"
    disk.mkdir()
    try:
        mounted = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", disk], capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        pytest.skip("there is no mount command")
    if mounted.returncode != 0:
        pytest.skip(f"a small disk cannot be mounted here: {mounted.stderr.strip()}")
    yield disk
    subprocess.run(["umount", disk], check=True)


def test_a_full_disk_stops_the_run_and_more_space_lets_it_resume(
    case, reference, small_disk, render_command, run_command
):
    out = small_disk / "out"
    ended = run_command(render_command(case, "--out", out, *ARGUMENTS, "--workers", 2))
    assert ended.returncode == 3
    assert ended.stderr.startswith(f"error: {out}: cannot write ")
    assert "(No space left on device); the views finished so far are safe: correct this and run" in ended.stderr
    finished = {name: data for name, data in tree(out).items() if "/frame/" in name}
    assert 0 < len(finished) < VIEWS
    expected = tree(reference)
    for name, record in finished.items():
        assert record == expected[name]
        assert all((out / file).read_bytes() == expected[file] for file in json.loads(record)["files"])
    subprocess.run(["mount", "-o", "remount,size=20m", small_disk], check=True)
    before = times(out)
    run_here(case, out)
    assert_same_dataset(out, reference)
    assert all(times(out)[name] == before[name] for name in finished)


# --- once it is complete --------------------------------------------------------------------------------------------


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


def test_a_removed_description_is_written_again_beside_the_run_s_records(case, reference, tmp_path):
    out = Path(shutil.copytree(reference, tmp_path / "out"))
    (out / "dataset.json").unlink()
    (out / "notes.txt").write_text("")
    before = tree(out)
    for options, message in [
        (dataclasses.replace(OPTIONS, seed=4), "found other files"),
        (dataclasses.replace(OPTIONS, count=29), r"a dataset of 30 views, and 29 are wanted: .* to 30 or more"),
    ]:
        with pytest.raises(RunError, match=message):
            run_here(case, out, options)
        assert tree(out) == before
    ViewPaths(out, 4).file("rgb").unlink()
    run_here(case, out)
    (out / "notes.txt").unlink()
    assert_same_dataset(out, reference)
    # as it was before it grew
    few, grown = tmp_path / "few", dataclasses.replace(OPTIONS, count=6)
    run_here(case, few, grown)
    (few / "dataset.json").unlink()
    run_here(case, few)
    assert_same_dataset(few, reference)


def test_a_dataset_grows_to_what_it_would_have_been(case, reference, tmp_path):
    out, few = tmp_path / "out", dataclasses.replace(OPTIONS, count=6)
    run_here(case, out, few)
    before = times(out)
    for index in range(2):
        run_here(case, out, OPTIONS, Shard(index, 2))
    assert_same_dataset(out, reference)
    assert all(times(out)[name] == before[name] for name in before if name.count("/") == 3)


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


def test_what_a_run_does_not_write_keeps_its_sum(case, reference, tmp_path):
    """A file that was changed behind the dataset's back is not taken for sound because another one was written."""
    out = Path(shutil.copytree(reference, tmp_path / "out"))
    harmed = ["models/obj_000001.ply", "train_synt/000000/scene_gt.json", "poses.csv"]
    for name in (*harmed, ViewPaths(out, 4).relative("frame")):
        data = (out / name).read_bytes()
        digit = max(data.rfind(bytes([number])) for number in b"0123456789")
        (out / name).write_bytes(data[:digit] + bytes([data[digit] ^ 1]) + data[digit + 1 :])
    before = json.loads((out / "checksums.json").read_text())
    run_here(case, out, dataclasses.replace(OPTIONS, video=True, video_frames=2))
    after = json.loads((out / "checksums.json").read_text())
    assert {name: after["files"][name] for name in before["files"]} == before["files"]
    assert after["records"] == before["records"]


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
    # what a full disk leaves of a video is recognised
    data, cut_off = (tmp_path / "v.mp4").read_bytes(), tmp_path / "cut.mp4"
    assert _is_whole(tmp_path / "v.mp4")
    for cut in (0, 100, len(data) // 2, len(data) - 1):
        cut_off.write_bytes(data[:cut])
        assert not _is_whole(cut_off)


# --- options --------------------------------------------------------------------------------------------------------


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
    for changed, first in ((poses[::-1], 0), (np.stack([*poses[:2], poses[0]]), 2)):
        np.save(tmp_path / "poses.npy", changed)
        with pytest.raises(RunError, match=rf"\(pose {first} \(counted from 0\) of the list has changed, which may"):
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
    with pytest.raises(RunError, match="listed poses reach to another depth: the scale of the depth images was"):
        run_list(out, np.stack([*poses, farther]))
    with pytest.raises(RunError, match=r"its poses were listed \(--poses\), now they are drawn"):
        run_here(case, out, OPTIONS)
    # also without a description
    description = (out / "dataset.json").read_bytes()
    (out / "dataset.json").unlink()
    with pytest.raises(RunError, match="found other files"):
        run_list(out, np.stack([*poses[:5], poses[0]]))
    run_list(out, poses)
    assert (out / "dataset.json").read_bytes() == description
    # a shard of another list
    other = poses.copy()
    other[4] = poses[0]
    for name, listed, index in (("other", other, 1), ("short", poses[:4], 0)):
        run_list(tmp_path / name, listed, Shard(index, 2))
        shutil.copytree(tmp_path / name, tmp_path / "differs", dirs_exist_ok=True)
    with pytest.raises(RunError, match="views of other poses than the listed ones are in the folder: 4"):
        run_list(tmp_path / "differs", poses)


def test_shards_of_fewer_and_of_more_views_are_merged(case, reference, tmp_path):
    few = dataclasses.replace(OPTIONS, count=24)
    run_here(case, tmp_path / "few", few, Shard(0, 2))
    run_here(case, tmp_path / "more", OPTIONS, Shard(1, 2))
    for last, first in (("few", "more"), ("more", "few")):
        out = tmp_path / f"{last} last"
        for part in (first, last):
            shutil.copytree(tmp_path / part, out, dirs_exist_ok=True)
        with pytest.raises(RunError, match=r"24 are wanted: .* set the number of views to 30 or more"):
            run_here(case, out, few)
        run_here(case, out)
        assert_same_dataset(out, reference)
