"""The dataset check: passes a sound dataset, names the file of every kind of damage, and sees errors of half a pixel.

The dataset is rendered without Blender and without the code that is tested.
"""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.commands import check
from oneframe.dataset.bop import write_models
from oneframe.dataset.check.findings import Findings
from oneframe.dataset.coco import compressed_counts, run_lengths
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.view import file_sums, write_view
from oneframe.dataset.view_record import read_record
from oneframe.images.contact_sheet import contact_sheet
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from oneframe.process.command_line import exit_code
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import rigid, rotation_from_vector
from tests.dataset.masks import coco_mask
from tests.dataset.sealing import sealed
from tests.dataset.synthetic_dataset import (
    CAMERA,
    CENTRE,
    COUNT,
    MESH,
    pose_of,
    write_pose_tables,
    write_tables,
)

pytestmark = pytest.mark.usefixtures("small_scenes")


@pytest.fixture(scope="module")
def run() -> Callable[..., int]:
    return lambda *arguments: exit_code(check.main, [str(argument) for argument in arguments])


def edit(path: Path, change: Callable[[dict], object]) -> None:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def substitute(path: Path, old: str, new: str) -> None:
    path.write_text(path.read_text().replace(old, new))


def flip_byte(path: Path, place: float = 0.6) -> None:
    data = bytearray(path.read_bytes())
    data[int(len(data) * place)] ^= 0x40
    path.write_bytes(data)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def swap(first: Path, second: Path) -> None:
    one, other = first.read_bytes(), second.read_bytes()
    first.write_bytes(other)
    second.write_bytes(one)


def replace_file(root: Path, index: int, kind: str, image: np.ndarray) -> None:
    """Another image with a record that has its hash: only the content differs."""
    paths = ViewPaths(root, index)
    record = read_record(paths)
    kinds = [name.split("/")[2] for name in record.files]
    files = {name: paths.file(name).read_bytes() for name in kinds} | {kind: encode_png(image)}
    write_view(paths, files, replace(record, files=file_sums(paths, files)))


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


def shift_mask(content: dict) -> None:
    """Move the first mask down by a pixel."""
    segmentation = content["annotations"][0]["segmentation"]
    mask = np.roll(coco_mask(segmentation), 1, axis=0)
    segmentation["counts"] = compressed_counts(run_lengths(mask))


def nudge(values: list, place: int = 0, by: float = 1e-6) -> None:
    values[place] += by


def test_a_sound_dataset_passes(sound, run, capsys):
    assert run(sound) == 0
    messages = capsys.readouterr().out
    assert f"dataset of {COUNT} views: complete and consistent (checked: hashes of {6 * COUNT + 22} files" in messages
    agreeing, shift = re.search(r"at ([\d.]+)% of .* largest shift of a view (\S+) px", messages).groups()
    assert float(agreeing) == 100
    assert float(shift) < 0.01


@pytest.mark.parametrize("arguments", [["--views", "2"], ["--fast"], ["--views", "0"]])
def test_a_sound_dataset_passes_with_options(sound, run, arguments):
    assert run(sound, *arguments) == 0


S0, S1 = "train_synt/000000", "train_synt/000001"
BESIDE = [
    "dataset.json", "camera.json", "poses.csv", "transforms.json", "contact_sheet.png", "overlay.png",
    "models/models_info.json",
    "models/obj_000001.ply", "video/trajectory.mp4", "video/poses.csv",
]  # fmt: skip
TABLES = [f"{S1}/scene_{name}.json" for name in ("camera", "gt", "gt_info", "gt_coco")]
OF_A_VIEW = [
    f"{S0}/rgb/000001.png", f"{S0}/depth/000001.png", f"{S0}/mask/000001_000000.png", f"{S0}/frame/000001.json",
    f"{S0}/mask_visib/000001_000000.png", f"{S0}/mask_observed/000001_000000.png", f"{S0}/depth_mm/000001.npy",
]  # fmt: skip


@pytest.mark.parametrize("name", [*BESIDE, *TABLES, *OF_A_VIEW])
@pytest.mark.parametrize("damage", [Path.unlink, cut], ids=["deleted", "cut off"])
def test_a_file_that_is_missing_or_cut_off_is_named(copied, run, capsys, name, damage):
    damage(copied / name)
    assert run(copied) == 1
    assert name in capsys.readouterr().out


@pytest.mark.parametrize("name", [name for name in OF_A_VIEW if "frame" not in name])
def test_a_flipped_byte_is_named(copied, run, capsys, name):
    flip_byte(copied / name)
    assert run(copied) == 1
    messages = capsys.readouterr().out
    assert f"{name}: its sha256" in messages
    assert "1 finding\n" in messages


def far_by(units: int, depth: np.ndarray) -> np.ndarray:
    return np.where(depth > 0, depth + units, 0).astype(np.uint16)


def rewrite_rotation(entry: dict) -> None:
    rotation = np.array(entry["cam_R_m2c"]).reshape(3, 3) * [1, 1, -1]
    entry["cam_R_m2c"] = rotation.ravel().tolist()


MUTATIONS = {
    "scene_gt translation": (
        lambda root: edit(root / S0 / "scene_gt.json", lambda c: nudge(c["1"][0]["cam_t_m2c"])),
        r"000000/scene_gt\.json: image 1: cam_t_m2c.*frame/000001\.json",
    ),
    "scene_gt object": (
        lambda root: edit(root / S0 / "scene_gt.json", lambda c: c["1"][0].update(obj_id=2)),
        r"scene_gt\.json: image 1: obj_id is 2, expected 1",
    ),
    "scene_gt entry too many": (
        lambda root: edit(root / S1 / "scene_gt.json", lambda c: c.update({"1": c["0"]})),
        r"000001/scene_gt\.json: expected an entry for each of 1 images, 1 unexpected \(1\)",
    ),
    "scene_gt not lists": (
        lambda root: edit(root / S0 / "scene_gt.json", lambda c: c.update({"1": 3})),
        r"scene_gt\.json: image 1: the entry is 3",
    ),
    "scene_camera K": (
        lambda root: edit(root / S0 / "scene_camera.json", lambda c: nudge(c["2"]["cam_K"], 2)),
        r"scene_camera\.json: image 2: cam_K",
    ),
    "scene_camera depth scale": (
        lambda root: edit(root / S0 / "scene_camera.json", lambda c: c["2"].update(depth_scale=1.0)),
        r"scene_camera\.json: image 2: depth_scale is 1\.0, expected 0\.01",
    ),
    "scene_gt_info": (
        lambda root: edit(root / S0 / "scene_gt_info.json", lambda c: c["0"][0].update(px_count_all=3)),
        r"scene_gt_info\.json: image 0: px_count_all is 3",
    ),
    "COCO box": (
        lambda root: edit(root / S0 / "scene_gt_coco.json", lambda c: nudge(c["annotations"][1]["bbox"], 2, 1)),
        r"scene_gt_coco\.json: annotation of image 1: bbox\[2\]",
    ),
    "COCO runs": (
        lambda root: edit(root / S0 / "scene_gt_coco.json", shift_mask),
        r"scene_gt_coco\.json: annotation of image 0: counts\[0\]",
    ),
    "COCO category": (
        lambda root: edit(root / S0 / "scene_gt_coco.json", lambda c: c["categories"][0].update(name="1")),
        r'scene_gt_coco\.json: categories: name is "1", expected "lumpy sphere"',
    ),
    "COCO image": (
        lambda root: edit(root / S0 / "scene_gt_coco.json", lambda c: c["images"][2].update(file_name="rgb/2.png")),
        r"scene_gt_coco\.json: image 2: file_name",
    ),
    "COCO twice": (
        lambda root: edit(root / S0 / "scene_gt_coco.json", lambda c: c["annotations"].append(c["annotations"][0])),
        r"scene_gt_coco\.json: annotations: expected different numbers",
    ),
    "camera.json": (
        lambda root: edit(root / "camera.json", lambda c: c.update(fy=c["fx"])),
        r"^camera\.json: fy is 151\.3, expected 147\.9",
    ),
    "camera.json depth scale": (
        lambda root: edit(root / "camera.json", lambda c: c.update(depth_scale=0.1)),
        r"^camera\.json: depth_scale is 0\.1, a view has 0\.01",
    ),
    "K in dataset.json": (
        lambda root: edit(root / "dataset.json", lambda c: nudge(c["camera"]["K"][0], 2)),
        r"^dataset\.json: camera: cx",
    ),
    "count in dataset.json": (
        lambda root: edit(root / "dataset.json", lambda c: c.update(count=COUNT - 1)),
        r"train_synt/000001: expected no such folder in a dataset of 3 views",
    ),
    "poses.csv number": (
        lambda root: substitute(root / "poses.csv", ",260.0,", ",260.001,"),
        r"^poses\.csv: row 0: the translation differs from that of train_synt/000000/frame/000000\.json by 0\.001",
    ),
    "poses.csv given frame": (
        lambda root: write_pose_tables(root, centre=CENTRE * 1.000001),
        r"^poses\.csv: row 0: mesh_t",
    ),
    "poses.csv order": (
        lambda root: write_pose_tables(root, [1, 0, 2, 3]),
        r"^poses\.csv: row 0: expected view 0 and its image",
    ),
    "transforms.json axes": (
        lambda root: edit(
            root / "transforms.json",
            lambda c: c["frames"][3].update(
                transform_matrix=(np.array(c["frames"][3]["transform_matrix"]) * [1, -1, -1, 1]).tolist()
            ),
        ),
        r"^transforms\.json: frame 3: the rotation differs",
    ),
    "transforms.json pixel origin": (
        lambda root: edit(root / "transforms.json", lambda c: c.update(cx=c["cx"] - 0.5)),
        r"^transforms\.json: cx is .* does not fit dataset\.json",
    ),
    "models_info": (
        lambda root: edit(root / "models/models_info.json", lambda c: c["1"].update(diameter=60.0)),
        r"^models/models_info\.json: diameter is 60\.0",
    ),
    "another model": (
        lambda root: write_models(root, MESH.scaled(1.01), np.zeros((len(MESH.vertices), 3), np.uint8)),
        r"depth/000000\.png: the surface projected .* does not fit",
    ),
    "model not demeaned": (
        lambda root: write_models(root, MESH.moved(np.array([0, 0, 0.01])), np.zeros((222, 3), np.uint8)),
        r"models/obj_000001\.ply: expected the mean of the vertices at the origin",
    ),
    "swapped rgb": (
        lambda root: swap(root / S0 / "rgb/000000.png", root / S0 / "rgb/000002.png"),
        r"000000/rgb/000002\.png: its sha256",
    ),
    "swapped records": (
        lambda root: swap(root / S0 / "frame/000000.json", root / S0 / "frame/000002.json"),
        r"frame/000002\.json: expected the record of view 2, found index 0",
    ),
    "stray view": (
        lambda root: shutil.copy(root / S1 / "rgb/000000.png", root / S1 / "rgb/000001.png"),
        r"train_synt/000001/rgb/000001\.png: expected no such file in a dataset of 4 views",
    ),
    "stray scene": (
        lambda root: shutil.copytree(root / S1, root / "train_synt/000002"),
        r"train_synt/000002: expected no such folder in a dataset of 4 views",
    ),
    "temporary file": (
        lambda root: (root / S0 / ".partial-12ab").write_bytes(b""),
        r"train_synt/000000/\.partial-12ab: left by a run that was stopped",
    ),
    "record without a hash": (
        lambda root: change_record(root, 1, lambda c: c["files"].popitem()),
        r"frame/000001\.json: expected sums of the view's 6 files, missing or unexpected: \S+/depth_mm/000001\.npy",
    ),
    "record without depth scale": (
        lambda root: change_record(root, 1, lambda c: c.pop("depth_scale"), tables=False),
        r"frame/000001\.json: expected other keys: missing \[\"depth_scale\"\]",
    ),
    "record with NaN": (
        lambda root: change_record(root, 1, lambda c: c["cam_t_m2c"].__setitem__(0, float("nan")), tables=False),
        r"frame/000001\.json: expected JSON, found a mistake: NaN is no number",
    ),
    "reflection": (
        lambda root: change_record(root, 1, rewrite_rotation),
        r"frame/000001\.json: cam_R_m2c: expected a rotation, found .* determinant -1",
    ),
    "scaled rotation": (
        lambda root: change_record(root, 1, lambda c: c.update(cam_R_m2c=[1.0001 * r for r in c["cam_R_m2c"]])),
        r"frame/000001\.json: cam_R_m2c: expected a rotation, found a matrix off by 0\.0002",
    ),
    "video pose": (
        lambda root: substitute(root / "video/poses.csv", ",0.7", ",0.71"),
        r"^video/poses\.csv: row \d: expected a rotation",
    ),
    "another size": (
        lambda root: replace_file(root, 1, "rgb", np.zeros((48, 63, 3), np.uint8)),
        r"rgb/000001\.png: expected 64x48 px with 3 channels of uint8, found 63x48 px",
    ),
    "grey rgb": (
        lambda root: replace_file(root, 1, "rgb", np.zeros((48, 64), np.uint8)),
        r"rgb/000001\.png: expected 64x48 px with 3 channels of uint8, found 64x48 px with 1 channel",
    ),
    "8-bit depth": (
        lambda root: replace_file(root, 1, "depth", image_of(root, 1, "mask")),
        r"depth/000001\.png: expected 64x48 px with 1 channel of uint16, found .* uint8",
    ),
    "mask of 0 and 1": (
        lambda root: replace_file(root, 1, "mask", image_of(root, 1, "mask") // 255),
        r"mask/000001_000000\.png: expected a mask of 0 and 255",
    ),
    "mask beside depth": (
        lambda root: replace_file(root, 1, "mask", np.roll(image_of(root, 1, "mask"), 1, axis=1)),
        r"mask/000001_000000\.png: \d+ px differ from where the depth image has surface",
    ),
    "visible beyond mask": (
        lambda root: replace_file(root, 1, "mask_visib", np.full(CAMERA.shape_hw, 255, np.uint8)),
        r"mask_visib/000001_000000\.png: \d+ px lie outside the mask \(first: u = 0, v = 0\)",
    ),
    "observed beyond mask": (
        lambda root: replace_file(root, 1, "mask_observed", np.full(CAMERA.shape_hw, 255, np.uint8)),
        r"mask_observed/000001_000000\.png: \d+ px lie outside the mask",
    ),
    "fewer visible": (
        lambda root: replace_file(root, 1, "mask_visib", np.zeros(CAMERA.shape_hw, np.uint8)),
        r"frame/000001\.json: px_count_visib is \d+, \S+mask_visib/000001_000000\.png has 0",
    ),
    "fewer observed": (
        lambda root: replace_file(root, 1, "mask_observed", np.zeros(CAMERA.shape_hw, np.uint8)),
        r"frame/000001\.json: px_count_observed is \d+, \S+mask_observed/000001_000000\.png has 0",
    ),
    "colour beyond the mask": (
        lambda root: replace_file(root, 1, "rgb", np.full((*CAMERA.shape_hw, 3), 9, np.uint8)),
        r"rgb/000001\.png: \d+ px outside the mask are not black",
    ),
    "float depth": (
        lambda root: replace_file(root, 1, "depth", far_by(2, image_of(root, 1, "depth"))),
        r"depth_mm/000001\.npy: \d+ px are not those of the depth image before rounding",
    ),
    "box": (
        lambda root: change_record(root, 1, lambda c: nudge(c["gt_info"]["bbox_visib"], 2, 1)),
        r"frame/000001\.json: bbox_visib is",
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


def swap_video_poses(root: Path) -> None:
    header, first, *others, last = (root / "video/poses.csv").read_text().splitlines()
    one, other = first.split(","), last.split(",")
    rows = [one[:2] + other[2:], *(row.split(",") for row in others), other[:2] + one[2:]]
    (root / "video/poses.csv").write_text("\n".join([header, *map(",".join, rows)]) + "\n")


def swap_pictures(root: Path) -> None:
    sheet = cv2.imread(str(root / "contact_sheet.png"))[..., ::-1]
    across = CAMERA.width + 4
    first, second, rest = sheet[:, 4 : 4 + across], sheet[:, 4 + across : 4 + 2 * across], sheet[:, 4 + 2 * across :]
    (root / "contact_sheet.png").write_bytes(encode_png(np.concatenate([sheet[:, :4], second, first, rest], axis=1)))


def write_model(root: Path, folder: str, mesh: TriangleMesh, normals: np.ndarray) -> None:
    colours = np.zeros((len(mesh.vertices), 3), np.uint8) if folder == "models" else None
    write_ply(root / folder / "obj_000001.ply", mesh, colours=colours, normals=normals)


def moved_vertex() -> TriangleMesh:
    vertices = MESH.vertices.copy()
    vertices[60] *= 1.05
    return replace(MESH, vertices=vertices)


SEALED = {
    "poses of the video": (swap_video_poses, r"^video/trajectory\.mp4: \d+ px of frame 0 lie beside the surface"),
    "pictures of the sheet": (swap_pictures, r"^contact_sheet\.png: the picture in row 1, column 1 is not \S+0\.png"),
    "a vertex": (
        lambda root: write_model(root, "models", moved_vertex(), moved_vertex().vertex_normals),
        r"^models/obj_000001\.ply: its vertices and faces do not have the geometry_sha256",
    ),
    "normals": (
        lambda root: write_model(root, "models", MESH, -MESH.vertex_normals),
        r"^models/obj_000001\.ply: 222 of 222 normals are not those of the surface",
    ),
    "the model for errors": (
        lambda root: write_model(root, "models_eval", moved_vertex(), moved_vertex().vertex_normals),
        r"^models_eval/obj_000001\.ply: expected the surface of models/obj_000001\.ply",
    ),
    "a key of transforms.json": (
        lambda root: edit(root / "transforms.json", lambda c: c.update(k1=0.1)),
        r"^transforms\.json: expected other keys: unknown \[\"k1\"\]",
    ),
    "a key of a frame": (
        lambda root: edit(root / "transforms.json", lambda c: c["frames"][1].update(fl_x=0.1)),
        r"^transforms\.json: frame 1: unexpected key \"fl_x\"",
    ),
    "a column": (
        lambda root: (root / "poses.csv").write_text((root / "poses.csv").read_text().replace("\n", ",1\n")),
        r"^poses\.csv: expected the columns index, image, r00",
    ),
    "an option": (
        lambda root: edit(root / "dataset.json", lambda c: c["options"].update(speed=1)),
        r"^dataset\.json: options: expected other keys: unknown",
    ),
    "a pose twice": (
        lambda root: change_record(root, 3, lambda c: c.update(cam_R_m2c=pose_of(1)[:3, :3].ravel().tolist(),
                                                               cam_t_m2c=pose_of(1)[:3, 3].tolist())),
        r"000001/frame/000000\.json: view 3 has the very pose of view 1",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SEALED)
def test_what_hashes_do_not_tell_is_found(copied, run, capsys, name):
    """All hashes are those of the changed files."""
    change, expected = SEALED[name]
    change(copied)
    assert run(sealed(copied)) == 1
    messages = capsys.readouterr().out
    assert re.search(expected, messages, re.MULTILINE), messages
    assert "sha256 or size" not in messages


def test_without_hashes_swapped_images_are_still_seen(copied, run, capsys):
    swap(copied / S0 / "rgb/000000.png", copied / S0 / "rgb/000002.png")
    assert run(copied, "--fast") == 1
    assert re.search(r"rgb/00000[02]\.png: (its sha256 or size|\d+ px outside the mask)", capsys.readouterr().out)


def test_without_hashes_a_flipped_byte_is_still_seen(copied, run, capsys):
    flip_byte(copied / S0 / "rgb/000001.png")
    assert run(copied, "--fast") == 1
    assert re.search(r"rgb/000001\.png: expected an intact PNG image", capsys.readouterr().out)


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
    "K by half a pixel in x": lambda root: shift_camera(root, cx=0.5),
    "K by half a pixel in y": lambda root: shift_camera(root, cy=-0.5),
    "K by a pixel": lambda root: shift_camera(root, cx=1.0),
    "the other pixel origin": lambda root: shift_camera(root, cx=0.5, cy=0.5),
    "half a pixel of focal length at the edge of the object": lambda root: shift_camera(root, fx=4.0, fy=4.0),
    "sideways": lambda root: move(root, 2, rigid(translation=[0.5 * 300 / CAMERA.fx, 0, 0])),
    "pan": lambda root: move(root, 2, rigid(rotation_from_vector(np.array([0, 0.5 / CAMERA.fx, 0])))),
    "roll": lambda root: move(root, 2, turned_about_centre(2, rotation_from_vector(np.array([0, 0, 0.03])))),
    "tilt": lambda root: move(root, 2, turned_about_centre(2, rotation_from_vector(np.array([0.03, 0, 0])))),
    "nearer by 1 %": lambda root: move(root, 2, rigid(translation=[0, 0, -3.0])),
}  # fmt: skip


@pytest.mark.parametrize("name", HALF_A_PIXEL)
def test_poses_and_k_that_are_off_by_half_a_pixel_in_all_files_alike_are_seen(copied, run, capsys, name):
    HALF_A_PIXEL[name](copied)
    assert run(copied) == 1
    assert re.search(r"depth/00000\d\.png: the surface projected .* does not fit", capsys.readouterr().out)


def test_a_stopped_run_is_unfinished_and_nothing_else(copied, run, capsys):
    (copied / ".work").mkdir()
    (copied / ".work" / "lock").touch()
    for name in ("frame/000000.json", "rgb/000000.png", "scene_gt.json"):
        (copied / S1 / name).unlink()
    for name in ("poses.csv", "transforms.json", "contact_sheet.png", "video/trajectory.mp4", "video/poses.csv"):
        (copied / name).unlink()
    (copied / S1 / "rgb" / ".partial-0123").touch()
    assert run(copied) == 1
    messages = capsys.readouterr().out
    assert "unfinished (3 of 4 views exist): run the same command" in messages
    assert "1 finding\n" in messages


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["nowhere"], "expected the folder of a dataset"),
        (["."], "expected the folder of a dataset"),
        (["other"], "expected the format 'oneframe dataset 2', found \"something\""),
    ],
)
def test_what_is_no_dataset_is_not_judged(tmp_path, monkeypatch, run, capsys, arguments, expected):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "dataset.json").write_text('{"format": "something"}')
    assert run(*arguments) == 2
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [[], ["a", "--views", "-1"], ["a", "--views", "x"], ["a", "--what"], ["a", "--rerender", "2"]]
)
def test_wrong_arguments(run, arguments):
    assert run(*arguments) == 2


def test_many_findings_are_counted_and_some_of_every_kind_shown():
    findings = Findings()
    for number in range(300):
        findings.add("broken things" if number % 3 else "lost things", f"thing {number}")
    findings.add("others", "the odd one")
    shown = findings.shown()
    assert len(findings) == 301
    assert len(shown) <= 20
    assert {"... and 195 more broken things", "... and 95 more lost things", "the odd one"} <= set(shown)
