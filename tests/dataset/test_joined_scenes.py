"""A queue rendered at once: what its own command makes of each case, and all of it as one dataset that BOP reads."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from oneframe.case.case_file import read_case
from oneframe.case.case_queue import NewFrame, add_frames
from oneframe.case.case_writer import write_case
from oneframe.dataset.check.check_dataset import check_dataset
from oneframe.dataset.joined_scenes import join_scenes
from oneframe.errors import InputError
from oneframe.surface.mesh_reader import read_mesh
from oneframe.transforms import rigid
from tests.tree import different_files

OPTIONS = ("--count", "2", "--workers", "2", "--engine", "raster", "--cone-deg", "20")


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
        aligned = replace(read_case(path, posed=False), posed=True, cam_from_mesh=pose, alignment={"method": "refined"})
        write_case(path, aligned)
    return tmp_path / "queue"


@pytest.mark.render
def test_a_queue_is_its_cases_and_one_dataset_of_bop(queue, tmp_path, run_command, render_command):
    ended = run_command(render_command(queue, "--out", tmp_path / "out", *OPTIONS))
    assert ended.returncode == 0, ended.stderr
    assert "c: left out, it is new" in ended.stdout
    alone = run_command(render_command(queue / "b" / "case.toml", "--out", tmp_path / "alone", *OPTIONS))
    assert alone.returncode == 0, alone.stderr
    assert different_files(tmp_path / "out" / "cases" / "b", tmp_path / "alone") == []

    bop = tmp_path / "out" / "bop"
    with pytest.raises(InputError, match="give one of the datasets of this queue"):
        check_dataset(bop)
    model = read_mesh(bop / "models" / "obj_000001.ply")[0].vertices
    assert (bop / "scenes.csv").read_text().split() == ["scene_id,case", "0,a", "1,b"]
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

    info = tmp_path / "out" / "cases" / "b" / "models" / "models_info.json"
    info.unlink()
    info.write_text("{}")
    with pytest.raises(InputError, match=r"expected the surface of .*a, found another one"):
        join_scenes({name: tmp_path / "out" / "cases" / name for name in ("a", "b")}, bop)
    assert (bop / "models" / "models_info.json").read_text() != "{}"
