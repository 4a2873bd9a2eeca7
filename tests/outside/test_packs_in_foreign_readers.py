"""Packs in the eyes of BOP's toolkit: its own loader gives what the folder of the dataset holds, for every view."""

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.dataset import layout
from oneframe.dataset.layout import ViewPaths
from oneframe.packing.pack import PackOptions, pack_dataset
from tests.dataset.synthetic_dataset import PER_SCENE

LOADER = """
import json, sys
from pathlib import Path
import numpy as np
from bop_toolkit_lib.dataset import bop_webdataset
pack, out = map(Path, sys.argv[1:])
for key, shard in json.loads((pack / "key_to_shard.json").read_text()).items():
    found = bop_webdataset.load_image_data(
        pack / f"shard-{shard:06d}.tar", key, rgb_suffix=".png", load_mask=True, load_gt=True, load_gt_info=True,
    )
    (truth,), (info,) = found["gt"], found["gt_info"]
    np.savez(
        out / f"{key}.npz", rgb=found["im_rgb"], depth=found["im_depth"], mask=found["mask"][0],
        mask_visib=found["mask_visib"][0], k=found["camera"]["cam_K"], r=truth["cam_R_m2c"], t=truth["cam_t_m2c"],
        obj_id=truth["obj_id"], bbox_visib=info["bbox_visib"], visib_fract=info["visib_fract"],
    )
"""


@pytest.fixture
def toolkit() -> dict[str, str]:
    """An environment in which the toolkit is imported: a checkout that BOP_TOOLKIT names, or the installed package."""
    environment = os.environ | {"PYTHONPATH": os.environ.get("BOP_TOOLKIT", "")}
    line = [sys.executable, "-c", "from bop_toolkit_lib.dataset import bop_webdataset"]
    if subprocess.run(line, env=environment, capture_output=True, check=False).returncode:
        pytest.skip("bop_toolkit_lib is not installed, and BOP_TOOLKIT names no checkout of thodan/bop_toolkit")
    return environment


def test_the_toolkit_gives_what_the_folder_holds(toolkit, ray_cast_dataset, tmp_path, monkeypatch):
    monkeypatch.setattr(layout, "VIEWS_PER_SCENE", PER_SCENE)
    pack, out = tmp_path / "packed", tmp_path / "loaded"
    out.mkdir()
    # in this process: others know no scenes of three views
    manifest = pack_dataset(ray_cast_dataset, pack, PackOptions(len(scene_keys(ray_cast_dataset))))
    ended = subprocess.run(
        [sys.executable, "-c", LOADER, pack, out], env=toolkit, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert sorted(path.stem for path in out.iterdir()) == scene_keys(ray_cast_dataset)
    for view in manifest.views:
        paths = ViewPaths(ray_cast_dataset, view)
        found = np.load(out / f"{paths.scene_id:06d}_{paths.image_id:06d}.npz")
        camera, (truth,), (info,) = (
            json.loads((paths.scene / f"scene_{name}.json").read_text())[str(paths.image_id)]
            for name in ("camera", "gt", "gt_info")
        )
        images = {kind: cv2.imread(str(paths.file(kind)), cv2.IMREAD_UNCHANGED) for kind in ("rgb", "depth", "mask")}
        np.testing.assert_array_equal(found["rgb"], images["rgb"][..., ::-1])
        np.testing.assert_array_equal(found["depth"], images["depth"].astype(np.float32) * camera["depth_scale"])
        np.testing.assert_array_equal(found["mask"], images["mask"] > 0)
        np.testing.assert_array_equal(found["mask_visib"], images["mask"] > 0)
        np.testing.assert_array_equal(found["k"], camera["cam_K"])
        np.testing.assert_array_equal(found["r"].ravel(), truth["cam_R_m2c"])
        np.testing.assert_array_equal(found["t"].ravel(), truth["cam_t_m2c"])
        assert (found["obj_id"], found["visib_fract"]) == (1, info["visib_fract"])
        np.testing.assert_array_equal(found["bbox_visib"], info["bbox_visib"])


def scene_keys(dataset: Path) -> list[str]:
    return sorted(f"{path.parts[-3]}_{path.stem}" for path in dataset.glob("train_synt/*/frame/*.json"))
