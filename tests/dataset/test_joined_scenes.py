"""A queue rendered at once: what its own command makes of each case, and all of it as one dataset that BOP reads."""

import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import pytest

from oneframe.case.case_file import read_case
from oneframe.case.case_queue import NewFrame, add_frames
from oneframe.case.case_writer import write_case
from oneframe.case.pose_record import PoseRecord
from oneframe.dataset.check.check_dataset import check_dataset
from oneframe.dataset.joined_scenes import join_scenes
from oneframe.errors import InputError
from oneframe.surface.mesh_reader import read_mesh
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import rigid
from tests.tree import different_files, tree

OPTIONS = ("--count", "2", "--workers", "1", "--engine", "raster", "--cone-deg", "20")


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
        aligned = replace(read_case(path, posed=False), posed=True, cam_from_mesh=pose, alignment=PoseRecord("refined"))
        write_case(path, aligned)
    return tmp_path / "queue"


@pytest.mark.render
def test_a_queue_is_its_cases_and_one_dataset_of_bop(queue, tmp_path, run_oneframe):
    ended = run_oneframe("render", queue, "--out", tmp_path / "out", *OPTIONS, "--stereo-mm", "24")
    assert ended.returncode == 0, ended.stderr
    assert "c: left out, it is new" in ended.stdout
    alone = run_oneframe("render", queue / "b" / "case.toml", "--out", tmp_path / "alone", *OPTIONS, "--stereo-mm=24")
    assert alone.returncode == 0, alone.stderr
    assert different_files(tmp_path / "out" / "cases" / "b", tmp_path / "alone") == []

    bop = tmp_path / "out" / "bop"
    with pytest.raises(InputError, match="give one of the datasets of this queue"):
        check_dataset(bop)
    model = read_mesh(bop / "models" / "obj_000001.ply")[0].vertices
    # names may be those of patients
    assert not (bop / "scenes.csv").exists()
    assert (tmp_path / "out" / "scenes.csv").read_text().split() == ["scene_id,obj_id,case", "0,1,a", "1,1,b"]
    read = set()
    for scene in sorted((bop / "train_synt").iterdir()):
        truth, cameras = (json.loads((scene / f"scene_{name}.json").read_text()) for name in ("gt", "camera"))
        for image, (entry,) in truth.items():
            k, rotation = (np.reshape(each, (3, 3)) for each in (cameras[image]["cam_K"], entry["cam_R_m2c"]))
            at = (model @ rotation.T + entry["cam_t_m2c"]) @ k.T
            at = at[:, :2] / at[:, 2:]
            mask = cv2.imread(str(scene / "mask" / f"{int(image):06d}_000000.png"), cv2.IMREAD_UNCHANGED) > 0
            depth = cv2.imread(str(scene / "depth" / f"{int(image):06d}.png"), cv2.IMREAD_UNCHANGED)
            assert np.array_equal(depth > 0, mask)
            columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
            low, high = at.min(axis=0).clip(0), np.minimum(at.max(axis=0), np.array(mask.shape[::-1]) - 1)
            np.testing.assert_allclose([columns[0], rows[0], columns[-1], rows[-1]], [*low, *high], atol=1.01)
            read.add((int(scene.name), int(image)))
    targets = json.loads((bop / "test_targets_bop19.json").read_text())
    assert {(each["scene_id"], each["im_id"]) for each in targets} == read == {(0, 0), (0, 1), (1, 0), (1, 1)}

    for left in sorted((bop / "train_synt").rglob("scene_gt.json")):
        right = bop / "right" / left.relative_to(bop)
        for (one,), (other,) in zip(*(json.loads(eye.read_text()).values() for eye in (right, left)), strict=True):
            assert one["cam_R_m2c"] == other["cam_R_m2c"]
            np.testing.assert_allclose(np.subtract(other["cam_t_m2c"], one["cam_t_m2c"]), [24, 0, 0], atol=1e-9)
    joined = tree(bop)
    datasets = {name: tmp_path / "out" / "cases" / name for name in ("a", "b")}
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: join_scenes(datasets, bop), range(8)))
    assert tree(bop) == joined
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["bop", "cases", "scenes.csv"]


@pytest.mark.render
def test_another_surface_is_another_object(queue, tmp_path, run_oneframe):
    """Of the same vertices, and so of the same box: other faces, which depth shows."""
    case = read_case(queue / "b" / "case.toml")
    mesh = read_mesh(case.mesh)[0]
    write_ply(tmp_path / "other.ply", replace(mesh, faces=mesh.faces[: len(mesh.faces) // 2]))
    write_case(case.path, replace(case, mesh=tmp_path / "other.ply"))
    (queue / "c" / "case.toml").write_bytes((queue / "b" / "case.toml").read_bytes().replace(b"b.png", b"a.png"))
    shutil.copytree(queue / "a", queue / ".hidden")
    bop = tmp_path / "out" / "bop"
    ended = run_oneframe("render", queue, "--out", tmp_path / "out", *OPTIONS)
    assert ended.returncode == 0, ended.stderr
    rows = (tmp_path / "out" / "scenes.csv").read_text().split()
    assert rows == ["scene_id,obj_id,case", "0,1,a", "1,2,b", "2,2,c"]
    for folder in ("models", "models_eval"):
        assert json.loads((bop / folder / "models_info.json").read_text()).keys() == {"1", "2"}
        assert sorted(path.name for path in (bop / folder).glob("*.ply")) == ["obj_000001.ply", "obj_000002.ply"]
    assert len(read_mesh(bop / "models" / "obj_000002.ply")[0].faces) == len(mesh.faces) // 2
    for scene, number in enumerate((1, 2, 2)):
        folder = bop / "train_synt" / f"{scene:06d}"
        own = json.loads((folder / "scene_gt.json").read_text())
        assert {entry["obj_id"] for (entry,) in own.values()} == {number}
        coco = json.loads((folder / "scene_gt_coco.json").read_text())
        assert {each["id"] for each in coco["categories"]} == {number}
        assert {each["category_id"] for each in coco["annotations"]} == {number}
        alone = tmp_path / "out" / "cases" / "abc"[scene] / "train_synt" / "000000"
        for table in ("scene_gt", "scene_camera", "scene_gt_info", "scene_gt_coco"):
            here, there = (json.loads((path / f"{table}.json").read_text()) for path in (folder, alone))
            assert here == there or (number == 2 and table in ("scene_gt", "scene_gt_coco"))
    targets = json.loads((bop / "test_targets_bop19.json").read_text())
    assert {(each["scene_id"], each["obj_id"]) for each in targets} == {(0, 1), (1, 2), (2, 2)}


@pytest.mark.render
def test_a_queue_is_read_before_anything_is_rendered(queue, tmp_path, run_oneframe):
    for change, message in (
        (lambda text: text.replace("size = [", "size = [1"), "error: b: case.toml: "),
        (lambda text: text.replace("../../case/b.png", "../../case/missing.png"), "error: b: "),
        (lambda text: text + "[dataset]\ncount = 0\n", "error: b: "),
    ):
        path = queue / "b" / "case.toml"
        text = path.read_text()
        path.write_text(change(text))
        ended = run_oneframe("render", queue, "--out", tmp_path / "out", *OPTIONS[2:])
        path.write_text(text)
        assert ended.returncode == 2
        assert ended.stderr.startswith(message), ended.stderr
        assert not (tmp_path / "out").exists()
