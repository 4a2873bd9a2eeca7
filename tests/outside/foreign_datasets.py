"""Two datasets for readers that others wrote: one made without Blender, one rendered by the command."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from oneframe.dataset import layout
from oneframe.transforms import rigid, rotation_from_vector
from tests.dataset.synthetic_dataset import PER_SCENE, make_dataset

OBJECT = "Schädel 1"
FRONTAL = rigid(np.diag([1.0, -1.0, -1.0]), [-12.0, -7.0, 340.0])
"""The pose of the frame of the tiny case."""


def listed_poses() -> list[np.ndarray]:
    """The whole surface, oblique; cut by the image; filling it; and one view that shows nothing."""
    turn = rigid(rotation_from_vector(np.array([0.4, 0.3, 0.7])))
    centre = rigid(translation=[12.0, -7.0, 40.0])
    oblique = rigid(translation=[1.5, -2.0, 200.0]) @ FRONTAL @ centre @ turn @ np.linalg.inv(centre)
    return [
        rigid(translation=[0.0, 0.0, 180.0]) @ FRONTAL,
        oblique,
        rigid(translation=[38.0, 21.0, 60.0]) @ FRONTAL,
        FRONTAL,
        rigid(translation=[500.0, 0.0, 0.0]) @ FRONTAL,
    ]


@pytest.fixture(scope="session")
def ray_cast_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes, rendered by casting rays at the triangles, without Blender."""
    root = tmp_path_factory.mktemp("ray-cast") / "dataset"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(layout, "VIEWS_PER_SCENE", PER_SCENE)
        make_dataset(root)
    return root


@pytest.fixture(scope="session")
def awkward_case(tmp_path_factory: pytest.TempPathFactory, write_tiny_case: Callable[[Path], Path]) -> Path:
    """The tiny case; its mesh has a name with a space and a letter beyond ASCII."""
    case = write_tiny_case(tmp_path_factory.mktemp("case") / "case")
    (case.parent / "surface.ply").rename(case.parent / f"{OBJECT}.ply")
    case.write_text(case.read_text().replace('"surface.ply"', f'"{OBJECT}.ply"\nname = "{OBJECT}"'), encoding="utf-8")
    return case


@pytest.fixture(scope="session")
def rendered_dataset(tmp_path_factory, awkward_case, run_oneframe) -> Path:
    """What the command writes for :func:`listed_poses`."""
    pytest.importorskip("bpy")
    folder = tmp_path_factory.mktemp("rendered")
    (folder / "poses.json").write_text(json.dumps([pose.tolist() for pose in listed_poses()]))
    out = folder / "dataset"
    ended = run_oneframe("render", awkward_case, "--out", out, "--poses", folder / "poses.json", "--workers", 1)
    assert ended.returncode == 0, ended.stderr
    return out


@pytest.fixture(params=["ray-cast", "rendered"])
def dataset(request: pytest.FixtureRequest) -> Path:
    """Both datasets in turn."""
    return request.getfixturevalue(f"{request.param.replace('-', '_')}_dataset")


def scenes(dataset: Path) -> Iterator[tuple[int, Path]]:
    """Number and folder of each scene."""
    for scene in sorted((dataset / "train_synt").iterdir()):
        yield int(scene.name), scene
