"""The command as a user starts it: a CT and labels in; surface, structures, picture and report out."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from oneframe.surface.mesh_reader import read_mesh

sitk = pytest.importorskip("SimpleITK")

SPACING, ORIGIN = (0.5, 0.4, 0.6), (-7.0, 30.0, 900.0)
CENTRE = np.array([3.0, 39.0, 912.0])
SECRET = "ZQXDOE"


@pytest.fixture
def surface(run_oneframe):
    return partial(run_oneframe, "surface")


def distances(centre: np.ndarray) -> np.ndarray:
    z, y, x = (np.arange(n) * SPACING[axis] + ORIGIN[axis] for n, axis in ((40, 2), (45, 1), (40, 0)))
    return np.sqrt((x - centre[0]) ** 2 + (y[:, None] - centre[1]) ** 2 + (z[:, None, None] - centre[2]) ** 2)


def save(path: Path, values: np.ndarray) -> Path:
    image = sitk.GetImageFromArray(values)
    image.SetSpacing(SPACING)
    image.SetOrigin(ORIGIN)
    image.SetMetaData("descrip", SECRET)
    sitk.WriteImage(image, str(path))
    return path


@pytest.fixture
def ct(tmp_path) -> Path:
    """A ball of bone of 8 mm in air, and an island."""
    values = np.clip(300 + (8 - distances(CENTRE)) * 1000, -1000, 1400).astype(np.int16)
    values[1:3, 1:3, 1:3] = 1000
    return save(tmp_path / "ct.nii.gz", values)


@pytest.fixture
def labels(tmp_path) -> Path:
    values = (distances(np.add(CENTRE, (2, 0, 0))) < 2.5).astype(np.uint8) + 2 * (distances(CENTRE - (4, 0, 0)) < 2)
    (tmp_path / "labels.json").write_text('{"labels": {"1": "Facial Nerve", "2": "Chorda tympani"}}')
    return save(tmp_path / "labels.nii.gz", values.astype(np.uint8))


def test_ct_and_labels_become_a_folder_that_a_second_run_replaces(ct, labels, tmp_path, surface):
    out = tmp_path / "out"
    removed = save(tmp_path / "removed.nrrd", (distances(np.add(CENTRE, (0, 0, 8))) < 4).astype(np.uint8))
    ended = surface(ct, "--out", out, "--labels", labels, "--remove", removed)
    assert (ended.returncode, ended.stderr) == (0, "")
    mesh, messages = read_mesh(out / "surface.ply")
    assert messages == []
    radius = np.linalg.norm(mesh.vertices - CENTRE, axis=1)
    cavity = np.abs(np.linalg.norm(mesh.vertices - CENTRE - (0, 0, 8), axis=1) - 4)
    assert np.minimum(np.abs(radius - 8), cavity).max() < 0.4
    assert (cavity < 0.3).sum() > 100

    record = json.loads((out / "surface.json").read_text())
    assert record["threshold_hu"] == 300
    assert record["surface"]["faces"] == len(mesh.faces)
    assert record["removed"]["volume_mm3"] == pytest.approx(2 * np.pi / 3 * 4**3, rel=0.2)
    nerve, _ = read_mesh(out / record["structures"]["facial_nerve"]["file"])
    np.testing.assert_allclose(nerve.vertices.mean(axis=0), np.add(CENTRE, (2, 0, 0)), atol=0.2)
    assert record["structures"]["chorda_tympani"]["colour"] == [0, 1, 0]
    written = [path for path in out.rglob("*") if path.is_file()]
    assert len(written) == 4
    assert not any(SECRET.encode() in path.read_bytes() for path in written)
    assert SECRET not in ended.stdout

    before = {path: path.read_bytes() for path in written}
    assert surface(ct, "--out", out, "--labels", labels, "--remove", removed).returncode == 0
    assert {path: path.read_bytes() for path in written} == before


PLAN = """
[margins_mm]
facial_nerve = 1.0

[[strokes]]
radius_mm = 3.0
points_mm = [[6.0, 39.0, 921.0], [6.0, 39.0, 914.0]]
"""


def test_drill_keeps_its_margin_and_what_it_came_near_to_is_reported(ct, labels, tmp_path, surface):
    plan = tmp_path / "drill.toml"
    plan.write_text(PLAN)
    ended = surface(ct, "--out", tmp_path / "out", "--labels", labels, "--drill", plan, "--tolerance", 0.1)
    assert (ended.returncode, ended.stderr) == (0, "")
    record = json.loads((tmp_path / "out" / "surface.json").read_text())
    nerve, chorda = record["drill"]["clearances"]
    assert (nerve["structure"], nerve["margin_mm"]) == ("facial_nerve", 1.0)
    # what sampling and simplification may move is added: half the diagonal of a voxel at right angles, and a little
    assert 1 <= nerve["smallest_mm"] < np.hypot(1, np.linalg.norm(SPACING) / 2) + 0.07
    assert (chorda["structure"], chorda["margin_mm"]) == ("chorda_tympani", None)
    assert "nearest to the drill: facial_nerve, " in ended.stdout
    mesh, _ = read_mesh(tmp_path / "out" / "surface.ply")
    made = np.linalg.norm(mesh.vertices - CENTRE, axis=1) < 7.5
    assert made.sum() > 50
    assert (np.linalg.norm(mesh.vertices[made] - CENTRE - (2, 0, 0), axis=1) > 2.5 + 1 - 0.1).all()

    assert "nothing is protected" not in ended.stdout

    # without the margin it goes through the nerve, which is said, and first of all that it may
    plan.write_text(PLAN.replace("facial_nerve = 1.0", ""))
    ended = surface(ct, "--out", tmp_path / "out", "--labels", labels, "--drill", plan, "--tolerance", 0.1)
    assert ended.returncode == 0
    assert "warning: facial_nerve: the drill went " in ended.stdout
    said = ended.stdout.splitlines()
    assert "warning: nothing is protected from the drill" in said[1]
    assert "bone above" in said[2]


def test_threshold_crop_and_islands_are_obeyed(ct, tmp_path, surface):
    crop = [*(CENTRE - 20), *(np.add(CENTRE, (20, 20, 0)))]
    raw = ("--smooth", 0, "--tolerance", 0)
    ended = surface(ct, "--out", tmp_path / "out", "--threshold", "800", "--crop", *crop, "--islands", "0.5", *raw)
    assert (ended.returncode, ended.stderr) == (0, "")
    mesh, _ = read_mesh(tmp_path / "out" / "surface.ply")
    ball = np.linalg.norm(mesh.vertices - CENTRE, axis=1) < 9
    assert not ball.all()
    # 500 HU at 1000 HU a mm
    open_side = mesh.vertices[:, 2] < CENTRE[2] - 0.5
    assert np.linalg.norm(mesh.vertices - CENTRE, axis=1)[ball & open_side].mean() == pytest.approx(7.5, abs=0.02)
    assert mesh.vertices[:, 2].max() <= CENTRE[2] + 2 * SPACING[2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["ct", "--out", "out", "--crop", "0", "0", "0", "1", "1", "1"], "expected a box in the volume"),
        (["ct", "--out", "out", "--labels", "ct"], "give a CT as the volume"),
        (["nan", "--out", "out"], "NaN or infinity in 1,800 voxels"),
    ],
    ids=str,
)
def test_what_cannot_be_is_one_line_and_leaves_nothing(arguments, message, ct, tmp_path, surface):
    lost = np.where(np.arange(40)[:, None, None] == 3, np.nan, distances(CENTRE)).astype(np.float32)
    places = {"nan": save(tmp_path / "nan.nii", lost), "ct": ct, "out": tmp_path / "out"}
    ended = surface(*(places.get(argument, argument) for argument in arguments))
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert message in ended.stderr
    assert not (tmp_path / "out").exists()
