"""The dataset check: passes a sound dataset, names the file of every kind of damage, and sees errors of half a pixel.

The dataset is rendered without Blender and without the code that is tested.
"""

import io
import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.commands.__main__ import dispatch
from oneframe.dataset.check import findings
from oneframe.dataset.check.check_dataset import check_dataset
from oneframe.dataset.layout import SPLIT, ViewPaths
from oneframe.dataset.run.resume_record import read_record
from oneframe.images.contact_sheet import contact_sheet
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from oneframe.process.command_line import exit_code
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import rigid, rotation_from_vector
from tests.dataset.blank_dataset import write_view
from tests.dataset.sealing import sealed
from tests.dataset.synthetic_dataset import (
    CAMERA,
    COUNT,
    MESH,
    pose_of,
    write_tables,
)

pytestmark = pytest.mark.usefixtures("small_scenes")


@pytest.fixture(scope="module")
def run() -> Callable[..., int]:
    return lambda *arguments: exit_code(dispatch, ["check", *map(str, arguments)])


def edit(path: Path, change: Callable[[dict], object]) -> None:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def substitute(path: Path, old: str, new: str) -> None:
    path.write_text(path.read_text().replace(old, new))


def flip_byte(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[int(len(data) * 0.6)] ^= 0x40
    path.write_bytes(data)


def say_otherwise(path: Path) -> None:
    path.write_bytes(b'{"depth_scale": 1e999, "identity": NaN, "frames": 3}')


def make_a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


DAMAGE: dict[str, Callable[[Path], None]] = {
    "deleted": Path.unlink, "cut off": cut, "flipped": flip_byte, "another": say_otherwise, "a folder": make_a_folder
}  # fmt: skip


def replace_file(root: Path, index: int, kind: str, image: np.ndarray) -> None:
    """Another image with a record that has its hash: only the content differs."""
    paths = ViewPaths(root, index)
    record = read_record(paths)
    kinds = [name.split("/")[2] for name in record.files]
    files = {name: paths.file(name).read_bytes() for name in kinds} | {kind: encode_png(image)}
    write_view(paths, files, record)


def image_of(root: Path, index: int, kind: str) -> np.ndarray:
    return cv2.imread(str(ViewPaths(root, index).file(kind)), cv2.IMREAD_UNCHANGED)


def sheet_of(root: Path) -> bytes:
    """The contact sheet of the views as they are."""
    images = [image_of(root, index, "rgb")[..., ::-1] / 255 for index in range(COUNT)]
    return encode_png(to_uint8(contact_sheet(images, columns=COUNT, tile_width=240)))


def change_record(root: Path, index: int, change: Callable[[dict], object], *, tables: bool = True) -> None:
    """Change a record and, so that they agree, all tables."""
    edit(ViewPaths(root, index).file("frame"), change)
    if tables:
        write_tables(root, CAMERA)


def nudge(values: list, place: int = 0, by: float = 1e-6) -> None:
    values[place] += by


def test_a_sound_dataset_passes(filmed, run, capsys):
    assert run(filmed) == 0
    messages = capsys.readouterr().out
    assert f"dataset of {COUNT} views: complete and consistent (checked: hashes of {7 * COUNT + 22} files" in messages
    assert re.search(r"at 100\.00% of \d+ px", messages)
    for arguments in (["--views", "2"], ["--fast"], ["--views", "0"]):
        assert run(filmed, *arguments) == 0


S0, S1 = "train_synt/000000", "train_synt/000001"
BESIDE = [
    "test_targets_bop19.json", "dataset_info.md", "models_eval/models_info.json", "models_eval/obj_000001.ply",
    "camera.json", "poses.csv", "transforms.json", "contact_sheet.png", "overlay.png", "models/models_info.json",
    "models/obj_000001.ply", "video/trajectory.mp4", "video/poses.csv",
]  # fmt: skip
TABLES = [f"{S1}/scene_{name}.json" for name in ("camera", "gt", "gt_info", "gt_coco_modal")]
OF_VIEWS = [
    [f"{S0}/rgb/000000.png", f"{S0}/depth/000001.png", f"{S0}/mask/000002_000000.png", f"{S1}/frame/000000.json"],
    [f"{S0}/mask_visib/000000_000000.png", f"{S0}/mask_observed/000001_000000.png", f"{S0}/depth_mm/000002.npy",
     f"{S1}/source_frame/000000.png"],
]  # fmt: skip
"""Of each view one file."""
TOGETHER = [["dataset.json"], ["checksums.json"], [*BESIDE, *TABLES, *OF_VIEWS[0]], OF_VIEWS[1]]
"""Files that are damaged at a time."""


@pytest.mark.parametrize("names", TOGETHER, ids=["description", "sums", "most", "others"])
@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_files_that_are_damaged_or_missing_are_named(filmed, run, monkeypatch, capsys, names, damage):
    monkeypatch.setattr(findings, "SHOWN", 1000)
    monkeypatch.setattr(findings, "SHOWN_OF_A_KIND", 1000)
    for name in names:
        damage(filmed / name)
    assert run(filmed) == 1
    found = capsys.readouterr().out
    assert [name for name in names if name not in found] == []


NUMBERS = ["camera.json", "models/models_info.json"]
NUMBERS += [f"{S0}/scene_{name}.json" for name in ("camera", "gt", "gt_info", "gt_coco_modal")]


def leaves(value: dict | list) -> Iterator[tuple[dict | list, object]]:
    """Every number and text in nested tables, as what holds it and its key."""
    for key, part in value.items() if isinstance(value, dict) else enumerate(value):
        if isinstance(part, dict | list):
            yield from leaves(part)
        elif part is not None and not isinstance(part, bool):
            yield value, key


def test_what_other_programs_leave_is_no_finding(copied, run):
    scene = copied / SPLIT / "000000"
    for name in ("rgb/._000000.png", "rgb/@eaDir/000000.png", "rgb.cache", ".DS_Store", "__MACOSX/rgb/._000000.png"):
        (scene / name).parent.mkdir(parents=True, exist_ok=True)
        (scene / name).write_bytes(b"theirs")
    assert run(copied) == 0
    (scene / "rgb" / "mine.png").write_bytes(b"mine")
    assert run(copied) == 1


@pytest.mark.parametrize("names", [NUMBERS, ["transforms.json"]], ids=len)
def test_any_value_of_a_table_that_changes_is_found(copied, rng, names):
    """Also if all hashes are those of the changed files; the numbers of ``transforms.json`` follow from others'."""
    whole = {name: (copied / name).read_text() for name in names}
    for _ in range(4):
        for name, text in whole.items():
            content = json.loads(text)
            places = list(leaves(content))
            holder, key = places[rng.integers(len(places))]
            value = holder[key]
            holder[key] = value + "?" if isinstance(value, str) else value + 1e-3 * max(1, abs(value))
            (copied / name).write_text(json.dumps(content))
        shown = check_dataset(sealed(copied), stream=io.StringIO()).findings.shown()
        assert [name for name in names if not any(name in line for line in shown)] == []


def rewrite_rotation(entry: dict) -> None:
    rotation = np.array(entry["cam_R_m2c"]).reshape(3, 3) * [1, 1, -1]
    entry["cam_R_m2c"] = rotation.ravel().tolist()


MUTATIONS = {
    "scene_gt entry too many": (
        lambda root: edit(root / S1 / "scene_gt.json", lambda c: c.update({"1": c["0"]})),
        r"000001/scene_gt\.json: it is not what the records of the views make of it; remove it",
    ),
    "record without a hash": (
        lambda root: change_record(root, 1, lambda c: c["files"].popitem()),
        r"frame/000001\.json: expected sums of the view's 7 files",
    ),
    "reflection": (
        lambda root: change_record(root, 1, rewrite_rotation),
        r"frame/000001\.json: expected a rotation, found .* determinant -1",
    ),
    "mask of 0 and 1": (
        lambda root: replace_file(root, 1, "mask", image_of(root, 1, "mask") // 255),
        r"mask/000001_000000\.png: expected a mask of 0 and 255",
    ),
    "mask beside depth": (
        lambda root: replace_file(root, 1, "mask", np.roll(image_of(root, 1, "mask"), 1, axis=1)),
        r"mask/000001_000000\.png: \d+ px differ from where the depth image has surface",
    ),
    "observed beyond mask": (
        lambda root: replace_file(root, 1, "mask_observed", np.full(CAMERA.shape_hw, 255, np.uint8)),
        r"mask_observed/000001_000000\.png: \d+ px lie outside the mask",
    ),
    "no source where observed": (
        lambda root: replace_file(root, 1, "source_frame", np.zeros(CAMERA.shape_hw, np.uint8)),
        r"source_frame/000001\.png: \d+ px differ from mask_observed",
    ),
    "a frame that the case has not": (
        lambda root: replace_file(root, 1, "source_frame", 3 * image_of(root, 1, "source_frame")),
        r"source_frame/000001\.png: \d+ px are of none of the 2 frames",
    ),
    "visible fraction": (
        lambda root: change_record(root, 1, lambda c: c["gt_info"].update(visib_fract=0.5)),
        r"frame/000001\.json: visib_fract is 0\.5, the counts give 1\.0",
    ),
    "runs": (
        lambda root: change_record(root, 1, lambda c: nudge(c["rle_counts"], 1, 1) or nudge(c["rle_counts"], 2, -1)),
        r"mask_visib/000001_000000\.png: 1 px differ from rle_counts of \S+frame/000001\.json",
    ),
    "whole silhouette": (
        lambda root: change_record(
            root, 1, lambda c: c["gt_info"].update(px_count_all=2 * c["gt_info"]["px_count_all"], visib_fract=0.5)
        ),
        r"frame/000001\.json: px_count_all is \d+, the surface covers \d+ px",
    ),
    "box of the whole object": (
        lambda root: change_record(root, 3, lambda c: nudge(c["gt_info"]["bbox_obj"], 2, -5)),
        r"000001/frame/000000\.json: bbox_obj is .*, that of the projected surface is",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MUTATIONS)
def test_damage_is_found_and_named(copied, run, capsys, name):
    mutate, expected = MUTATIONS[name]
    mutate(copied)
    assert run(copied) == 1
    messages = capsys.readouterr().out
    assert re.search(expected, messages, re.MULTILINE), messages
    assert "NOT complete and consistent" in messages.splitlines()[-1]


def test_what_hashes_do_not_tell_is_found(copied, run, capsys):
    """All hashes are those of the changed files."""
    vertices = MESH.vertices.copy()
    vertices[60] *= 1.05
    mesh, colours = replace(MESH, vertices=vertices), np.zeros(vertices.shape, np.uint8)
    write_ply(copied / "models" / "obj_000001.ply", mesh, colours=colours, normals=mesh.vertex_normals)
    substitute(copied / "poses.csv", "\n", ",1\n")
    assert run(sealed(copied)) == 1
    messages = capsys.readouterr().out
    assert "models/obj_000001.ply: its vertices and faces do not have the geometry_sha256" in messages
    assert "poses.csv: it is not what the records of the views make of it" in messages
    assert "has changed" not in messages


@pytest.mark.parametrize(("margin_px", "code"), [(0, 0), (1, 1)])
def test_anti_aliased_colours_end_where_the_mask_does(copied, run, margin_px, code):
    edit(copied / "dataset.json", lambda c: c["options"].update(samples=4))
    wider = cv2.dilate(image_of(copied, 1, "mask"), np.ones(2 * (2 * margin_px + 1,), np.uint8))
    replace_file(copied, 1, "rgb", np.repeat(wider[..., None], 3, axis=2))
    (copied / "contact_sheet.png").write_bytes(sheet_of(copied))
    assert run(sealed(copied)) == code


def shift_camera(root: Path, **shift: float) -> None:
    """Another K in every file."""
    camera = replace(CAMERA, **{name: getattr(CAMERA, name) + by for name, by in shift.items()})
    edit(root / "dataset.json", lambda c: c["camera"].update({**asdict(camera), "K": camera.k.tolist()}))
    write_tables(root, camera)


def move(root: Path, index: int, cam_from_cam: np.ndarray) -> None:
    """Another pose of one view in every file."""
    pose = cam_from_cam @ pose_of(index)
    change_record(
        root, index, lambda c: c.update(cam_R_m2c=pose[:3, :3].ravel().tolist(), cam_t_m2c=pose[:3, 3].tolist())
    )


def turned_about_centre(index: int, rotation: np.ndarray) -> np.ndarray:
    there = rigid(translation=pose_of(index)[:3, 3])
    back = rigid(translation=-pose_of(index)[:3, 3])
    return there @ rigid(rotation) @ back


HALF_A_PIXEL = {
    "the other pixel origin": lambda root: shift_camera(root, cx=0.5, cy=0.5),
    "half a pixel of focal length at the edge of the object": lambda root: shift_camera(root, fx=4.0, fy=4.0),
    "sideways": lambda root: move(root, 2, rigid(translation=[0.5 * 300 / CAMERA.fx, 0, 0])),
    "roll": lambda root: move(root, 2, turned_about_centre(2, rotation_from_vector(np.array([0, 0, 0.03])))),
    "tilt": lambda root: move(root, 2, turned_about_centre(2, rotation_from_vector(np.array([0.03, 0, 0])))),
    "nearer by 1 %": lambda root: move(root, 2, rigid(translation=[0, 0, -3.0])),
}  # fmt: skip


@pytest.mark.parametrize("name", HALF_A_PIXEL)
def test_poses_and_k_off_by_half_a_pixel_in_all_files_alike_are_seen(copied, run, capsys, name):
    HALF_A_PIXEL[name](copied)
    assert run(copied) == 1
    assert re.search(r"depth/00000\d\.png: the surface projected .* does not fit", capsys.readouterr().out)


def test_a_stopped_run_is_unfinished_and_nothing_else(copied, run, capsys):
    (copied / ".work").mkdir()
    (copied / ".work" / "lock").touch()
    for name in ("frame/000000.json", "rgb/000000.png", "scene_gt.json"):
        (copied / S1 / name).unlink()
    for name in ("poses.csv", "transforms.json", "contact_sheet.png"):
        (copied / name).unlink()
    (copied / S1 / "rgb" / ".partial-0123").touch()
    assert run(copied) == 1
    messages = capsys.readouterr().out
    assert "unfinished (3 of 4 views exist): run the same `oneframe render`" in messages
    assert "1 finding\n" in messages


def test_what_is_no_dataset_is_not_judged(tmp_path, run, capsys):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "dataset.json").write_text('{"format": "something"}')
    for name, expected in (
        ("nowhere", "expected the folder of a dataset"),
        (".", "expected the folder of a dataset"),
        ("other", "expected the format 'oneframe dataset 2', found 'something'"),
    ):
        assert run(tmp_path / name) == 2
        assert expected in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="links of POSIX")
def test_links_that_lead_out_are_named(copied, tmp_path, run, capsys):
    names = ("models", f"{SPLIT}/000000/rgb/000001.png", "LICENSE")
    (copied / "LICENSE").write_text("free")
    for number, name in enumerate(names):
        shutil.move(copied / name, tmp_path / str(number))
        (copied / name).symlink_to(tmp_path / str(number))
    assert run(copied) == 1
    messages = capsys.readouterr().out
    for name in names:
        assert f"{name}: expected a part of the dataset, found a link that leads out" in messages


def test_tables_may_differ_by_rounding_and_by_nothing_else(copied):
    """Another processor or another numpy gives other last digits."""
    table = copied / "transforms.json"

    def is_found(change: Callable[[np.ndarray], np.ndarray]) -> bool:
        matrix = json.loads(table.read_text())["frames"][3]["transform_matrix"]
        substitute(table, json.dumps(matrix), json.dumps(change(np.array(matrix)).tolist()))
        return bool(check_dataset(sealed(copied), stream=io.StringIO()).findings)

    assert not is_found(lambda matrix: np.nextafter(matrix, 1e6))
    assert is_found(lambda matrix: 1.00001 * matrix)
