"""What is wrong in all files of a dataset alike is found, and a dataset that nobody changed has no findings.

Damage to single files is for the plain check (tests/dataset). The rendering from the case proves the rest.
"""

import io
import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.blender.dataset import run as dataset_run
from oneframe.blender.dataset.job import Job
from oneframe.blender.dataset.rerender import CaseRenderer
from oneframe.blender.render.video import write_video
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import Case, read_case
from oneframe.dataset.check.check_dataset import CheckReport, check_dataset
from oneframe.dataset.check.rerendered import Rerendering
from oneframe.dataset.layout import SPLIT, ViewPaths
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.resume_record import read_record
from oneframe.dataset.run.run_folder import Shard
from oneframe.dataset.tables.bop import is_test_target, write_scene, write_test_targets
from oneframe.dataset.tables.pose_tables import write_poses
from oneframe.errors import InputError
from oneframe.images.contact_sheet import contact_sheet
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from oneframe.video.film_reader import read_video_frame
from tests.dataset.sealing import sealed

pytestmark = pytest.mark.render

VIEWS, FRAMES = 6, 8
OPTIONS = DatasetOptions(count=VIEWS, seed=3, float_depth=True, video=True, video_frames=FRAMES)
SCENE = f"{SPLIT}/000000"
KINDS = ("rgb", "depth", "mask", "mask_visib", "mask_observed", "depth_mm", "frame")


def render(case: Path, out: Path, options: DatasetOptions = OPTIONS, shard: Shard | None = None) -> Path:
    job = Job(read_case(case), out, options, shard or Shard())
    dataset_run.run(job, workers=1, worker_command=(), stream=io.StringIO())
    return out


@pytest.fixture(scope="session")
def case(tmp_path_factory, write_tiny_case) -> Path:
    return write_tiny_case(tmp_path_factory.mktemp("tampered case"))


@pytest.fixture(scope="session")
def untouched(case, tmp_path_factory) -> Path:
    return render(case, tmp_path_factory.mktemp("untouched") / "dataset")


@pytest.fixture
def copies(untouched, tmp_path) -> Callable[[], Path]:
    """Makes a fresh copy of the dataset."""

    def fresh() -> Path:
        shutil.rmtree(tmp_path / "dataset", ignore_errors=True)
        return Path(shutil.copytree(untouched, tmp_path / "dataset"))

    return fresh


def rerendering(case: Case) -> Rerendering:
    return Rerendering(lambda description: CaseRenderer(case, description.content, None), views=0)


def checked(root: Path, case: Path | None = None) -> CheckReport:
    """The report of the check; against the case, and with all views rendered again, if there is one."""
    if case is None:
        return check_dataset(root, stream=io.StringIO())
    loaded = read_case(case)
    return check_dataset(root, case=loaded, rerendering=rerendering(loaded), stream=io.StringIO())


def is_found(root: Path, case: Path | None = None) -> bool:
    try:
        return bool(checked(root, case).findings)
    except InputError:  # no dataset any more
        return True


# --- a dataset that nobody changed

UNTOUCHED = {
    "cycles": replace(OPTIONS, colour="vertex", sampler="trajectory", samples=4, points=True, video=False),
    "eevee": replace(OPTIONS, engine="eevee", count=2, video=False),
    "raster": replace(OPTIONS, engine="raster", unseen="fill", samples=4, normals=True, points=True, video=False),
}


def test_an_untouched_dataset_has_no_findings(untouched, case):
    report = checked(untouched, case)
    assert not report.findings, report.findings.shown()
    assert report.rerendered == VIEWS
    assert "6 views rendered again from the case are the same" in report.summary()


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.gl] * (name == "eevee")) for name in UNTOUCHED])
def test_no_kind_of_dataset_raises_a_false_alarm(case, tmp_path, name):
    report = checked(render(case, tmp_path / "out", UNTOUCHED[name]), case)
    assert not report.findings, report.findings.shown()


def test_a_grainy_video_raises_no_false_alarm(case, tmp_path, rng):
    """The encoder drops a large part of the grain; a darker video is found all the same."""
    grainy = Path(shutil.copytree(case.parent, tmp_path / "case")) / case.name
    noise = rng.integers(0, 256, cv2.imread(str(grainy.parent / "frame.png")).shape, np.uint8)
    (grainy.parent / "frame.png").write_bytes(encode_png(noise))
    root = render(grainy, tmp_path / "out")
    report = checked(root, grainy)
    assert not report.findings, report.findings.shown()
    frames = [read_video_frame(root / "video/trajectory.mp4", index) for index in range(FRAMES)]
    write_video(root / "video/trajectory.mp4", (frame * 0.6 / 255 for frame in frames))
    tables_again(root)
    (finding,) = checked(root, grainy).findings.shown()
    assert "video/trajectory.mp4: frame 0 differs by" in finding


def test_merged_shards_and_listed_poses_raise_no_false_alarm(case, tmp_path):
    options = replace(OPTIONS, video=False)
    for index in range(3):
        shutil.copytree(
            render(case, tmp_path / f"part {index}", options, Shard(index, 3)), tmp_path / "all", dirs_exist_ok=True
        )
    report = checked(render(case, tmp_path / "all", options), case)
    assert not report.findings, report.findings.shown()

    # the same pose twice is no copy if the user listed it twice
    pose = np.array([[1.0, 0, 0, -12], [0, -1, 0, -7], [0, 0, -1, 340], [0, 0, 0, 1]])
    np.save(tmp_path / "poses.npy", np.stack([pose, pose]))
    listed = render(case, tmp_path / "listed", replace(options, poses=str(tmp_path / "poses.npy")))
    again = Rerendering(
        lambda description: CaseRenderer(read_case(case), description.content, tmp_path / "poses.npy"), views=0
    )
    report = check_dataset(
        listed, case=read_case(case), poses=tmp_path / "poses.npy", rerendering=again, stream=io.StringIO()
    )
    assert not report.findings, report.findings.shown()
    with pytest.raises(InputError, match="give it with --poses"):
        checked(listed, case)


def swap(one: Path, other: Path) -> None:
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)


def write(path: Path, content: object) -> None:
    path.write_text(json.dumps(content))


# --- the content is changed, and every table and hash with it


def image_of(root: Path, index: int, kind: str) -> np.ndarray:
    image = cv2.imread(str(ViewPaths(root, index).file(kind)), cv2.IMREAD_UNCHANGED)
    return image[..., ::-1] if image.ndim == 3 else image


def tables_again(root: Path) -> Path:
    """Make all tables, the contact sheet and all hashes again from the views as they are now."""
    content = json.loads((root / "dataset.json").read_text())
    k, camera = np.array(content["camera"]["K"]), content["camera"]
    intrinsics = PinholeCamera.from_matrix(k, size=(camera["width"], camera["height"]), where="K")
    for index in range(VIEWS):
        record = ViewPaths(root, index).file("frame")
        write(record, json.loads(record.read_text()) | {"index": index})
    sealed(root)
    box = json.loads((root / "models/models_info.json").read_text())["1"]
    low, size = (np.array([box[f"{what}_{axis}"] for axis in "xyz"]) for what in ("min", "size"))
    depth_scale = json.loads((root / "camera.json").read_text())["depth_scale"]
    records = [read_record(ViewPaths(root, index)) for index in range(VIEWS)]
    write_scene(root, records, intrinsics, content["object"])
    mesh_from_model = np.array(content["mesh_from_model"])
    write_poses(root, records, intrinsics, mesh_from_model, bounds=np.stack([low, low + size]), depth_scale=depth_scale)
    write_test_targets(root, [record.index for record in records if is_test_target(record)])
    images = [image_of(root, index, "rgb") / 255 for index in range(VIEWS)]
    (root / "contact_sheet.png").write_bytes(encode_png(to_uint8(contact_sheet(images, columns=6, tile_width=240))))
    return sealed(root)


def replace_rgb(root: Path) -> None:
    image = image_of(root, 2, "rgb")
    ViewPaths(root, 2).file("rgb").write_bytes(encode_png(np.ascontiguousarray(image[..., ::-1])))


def swap_views(root: Path) -> None:
    """Views 1 and 4 under each other's number."""
    one, other = ViewPaths(root, 1), ViewPaths(root, 4)
    for kind in KINDS:
        swap(one.file(kind), other.file(kind))
    for paths, old in ((one, "000004"), (other, "000001")):
        text = paths.file("frame").read_text()
        new = f"{paths.image_id:06d}"
        paths.file("frame").write_text(text.replace(f"{old}.", f"{new}.").replace(f"{old}_", f"{new}_"))


def see_more(root: Path) -> None:
    """All of the surface in view 3 was seen by the frame."""
    mask = image_of(root, 3, "mask")
    ViewPaths(root, 3).file("mask_observed").write_bytes(encode_png(mask))
    record = ViewPaths(root, 3).file("frame")
    write(record, json.loads(record.read_text()) | {"px_count_observed": int((mask > 0).sum())})


def swap_video_poses(root: Path) -> None:
    header, *rows = (root / "video/poses.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    cells[1][2:], cells[5][2:] = cells[5][2:], cells[1][2:]
    (root / "video/poses.csv").write_text("\n".join([header, *(",".join(row) for row in cells)]) + "\n")


def other_overlay(root: Path) -> None:
    picture = cv2.imread(str(root / "overlay.png"))
    (root / "overlay.png").write_bytes(encode_png(np.ascontiguousarray(255 - picture)))


def test_what_is_wrong_in_all_files_alike_is_found_by_rendering_again(copies, case):
    """The content of a video is found in the test of a grainy one."""
    root = copies()
    for change in (replace_rgb, swap_views, see_more, swap_video_poses, other_overlay):
        change(root)
    tables_again(root)
    assert not checked(root).findings
    views = [
        f"{SCENE}/{name}" for name in ("frame/000001.json", "rgb/000002.png", "frame/000003.json", "frame/000004.json")
    ]
    found = [finding.partition(": ")[0] for finding in checked(root, case).findings.shown()]
    assert found == ["overlay.png", *views, "video/poses.csv"]


def test_a_description_of_other_views_is_found_by_rendering_again(copies, case):
    root = copies()
    content = json.loads((root / "dataset.json").read_text())
    content["options"]["seed"] += 1
    write(root / "dataset.json", content)
    assert is_found(root)
    assert is_found(sealed(root), case)


def test_the_command_renders_again(untouched, case, run_command):
    script = Path(__file__).resolve().parents[2] / "scripts" / "oneframe.py"
    ended = run_command([sys.executable, str(script), "check", str(untouched), "--case", str(case), "--rerender", "2"])
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "2 views rendered again from the case are the same" in ended.stdout


def test_the_case_must_be_the_one_that_was_rendered(untouched, case, tmp_path):
    folder = tmp_path / "case"
    shutil.copytree(case.parent, folder)
    image = cv2.imread(str(folder / "frame.png"))
    (folder / "frame.png").write_bytes(encode_png(np.ascontiguousarray(image[::-1])))
    report = check_dataset(untouched, case=read_case(folder / case.name), stream=io.StringIO())
    (finding,) = report.findings.shown()
    assert finding == f"dataset.json: inputs_sha256: {folder / 'frame.png'} is not the frame of the dataset"
