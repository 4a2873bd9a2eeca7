"""Datasets in the eyes of readers that others wrote: pycocotools, BOP's toolkit, Nerfstudio."""

import contextlib
import io
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.surface.mesh_reader import read_mesh
from oneframe.transforms import rigid
from tests.conftest import intersect
from tests.outside.foreign_datasets import OBJECT, scenes

DELTA_MM = 15.0
"""Tolerance of the toolkit's test for visibility."""


# --- COCO


def evaluated(truth, detections: list[dict], kind: str) -> float:
    """The average precision over IoU 0.5 to 0.95 that pycocotools reports."""
    cocoeval = pytest.importorskip("pycocotools.cocoeval")
    with contextlib.redirect_stdout(io.StringIO()):
        evaluation = cocoeval.COCOeval(truth, truth.loadRes(detections), kind)
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    return float(evaluation.stats[0])


def detections(scene: Path, *, shift_px: int = 0) -> list[dict]:
    """What a perfect detector makes of the mask images; off by so many pixels."""
    coder = pytest.importorskip("pycocotools.mask")
    found = []
    for path in sorted((scene / "mask_visib").glob("*.png")):
        mask = np.roll(cv2.imread(str(path), cv2.IMREAD_UNCHANGED) > 0, shift_px, axis=1)
        if mask.any():
            code = coder.encode(np.asfortranarray(mask.astype(np.uint8)))
            entry = {"image_id": int(path.stem.split("_")[0]), "category_id": 1, "score": 0.9}
            found.append(entry | {"bbox": coder.toBbox(code).tolist(), "segmentation": code})
    return found


def test_a_perfect_detector_scores_one_by_pycocotools(dataset):
    coco = pytest.importorskip("pycocotools.coco")
    for _, scene in scenes(dataset):
        with contextlib.redirect_stdout(io.StringIO()):
            truth = coco.COCO(str(scene / "scene_gt_coco.json"))
        (category,) = truth.loadCats(truth.getCatIds())
        assert category["name"] == json.loads((dataset / "dataset.json").read_text())["object"]
        for image in truth.loadImgs(truth.getImgIds()):
            assert cv2.imread(str(scene / image["file_name"])).shape[:2] == (image["height"], image["width"])
            path = scene / "mask_visib" / f"{image['id']:06d}_000000.png"
            mask = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) > 0
            annotations = truth.loadAnns(truth.getAnnIds(imgIds=image["id"]))
            assert len(annotations) == mask.any()
            for annotation in annotations:
                np.testing.assert_array_equal(truth.annToMask(annotation) > 0, mask)
                assert annotation["area"] == np.count_nonzero(mask)
        itself = [{**annotation, "score": 1.0} for annotation in truth.dataset["annotations"]]
        for kind in ("bbox", "segm"):
            assert evaluated(truth, detections(scene), kind) == pytest.approx(1)
            assert evaluated(truth, itself, kind) == pytest.approx(1)
            assert evaluated(truth, detections(scene, shift_px=3), kind) < 0.9


def test_the_rendered_dataset_has_what_readers_stumble_over(rendered_dataset):
    """A name beyond ASCII, a whole surface, one that the image cuts, and none."""
    ((_, scene),) = scenes(rendered_dataset)
    (category,) = json.loads((scene / "scene_gt_coco.json").read_text(encoding="utf-8"))["categories"]
    assert category["name"] == OBJECT
    fractions = [info["visib_fract"] for (info,) in json.loads((scene / "scene_gt_info.json").read_text()).values()]
    assert min(fractions) == 0
    assert max(fractions) == 1
    assert any(0.1 < fraction < 0.9 for fraction in fractions)


# --- BOP: the toolkit's rules in short, and the toolkit itself


def depth_of_model(dataset: Path, k: np.ndarray, pose: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """``(3 H, 3 W)`` depth of ``models/`` on the toolkit's canvas, cast ray by ray without a renderer."""
    width, height = (3 * side for side in size)
    wide = PinholeCamera(width, height, k[0, 0], k[1, 1], k[0, 2] + size[0], k[1, 2] + size[1])
    v, u = np.mgrid[:height, :width]
    mesh, _ = read_mesh(dataset / "models" / "obj_000001.ply")
    depth, _ = intersect(mesh, wide, pose, np.stack([u, v], -1).reshape(-1, 2).astype(float))
    return depth.reshape(height, width)


def box_of(mask: np.ndarray, offset: tuple[int, int] = (0, 0)) -> list[int]:
    """The toolkit's ``calc_2d_bbox``."""
    if not mask.any():
        return [-1, -1, -1, -1]
    ys, xs = mask.nonzero()
    return [int(xs.min()) - offset[0], int(ys.min()) - offset[1], int(np.ptp(xs)), int(np.ptp(ys))]


def as_the_toolkit_counts(dataset: Path, scene: Path, image: str) -> tuple[dict, dict]:
    """An entry of ``scene_gt_info.json`` as in the toolkit's calc_gt_info.py, and ours."""
    camera, (truth,), (info,) = (
        json.loads((scene / f"scene_{name}.json").read_text())[image] for name in ("camera", "gt", "gt_info")
    )
    path = scene / "depth" / f"{int(image):06d}.png"
    depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.float32) * np.float32(camera["depth_scale"])
    height, width = depth.shape
    k = np.reshape(camera["cam_K"], (3, 3))
    pose = rigid(np.reshape(truth["cam_R_m2c"], (3, 3)), truth["cam_t_m2c"])
    wide = depth_of_model(dataset, k, pose, (width, height))
    inside = wide[height : 2 * height, width : 2 * width]
    v, u = np.mgrid[:height, :width]
    length = np.linalg.norm(np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(u.shape)]), axis=0)
    visible = ((inside - depth) * length <= DELTA_MM) & (inside > 0) | (depth == 0) & (inside > 0)
    visib, whole = int(visible.sum()), int((wide > 0).sum())
    computed = {
        "px_count_all": whole,
        "px_count_valid": int((depth[inside > 0] > 0).sum()),
        "px_count_visib": visib,
        "visib_fract": visib / whole if whole else 0.0,
        "bbox_obj": box_of(wide > 0, (width, height)) if visib else [-1, -1, -1, -1],
        "bbox_visib": box_of(visible),
    }
    return computed, info


def assert_same_info(computed: dict, info: dict) -> None:
    """Equal up to the pixels whose centre lies on an edge."""
    assert computed.keys() == info.keys()
    for key, value in computed.items():
        tolerance = 0.005 if key == "visib_fract" else 1 if key.startswith("bbox") else 2
        assert np.abs(np.subtract(info[key], value)).max() <= tolerance, (key, info[key], value)


def test_pictures_lie_where_the_toolkit_looks_and_its_counts_are_ours(dataset):
    """``get_split_params(path, name, "train", "synt")``: PNG unless the type is pbr; ids from 0 as in the tables."""
    for scene_id, scene in scenes(dataset):
        assert scene == dataset / f"train_synt/{scene_id:06d}"
        for image in json.loads((scene / "scene_gt.json").read_text()):
            assert all((scene / kind / f"{int(image):06d}.png").is_file() for kind in ("rgb", "depth"))
            assert all((scene / kind / f"{int(image):06d}_000000.png").is_file() for kind in ("mask", "mask_visib"))
            computed, info = as_the_toolkit_counts(dataset, scene, image)
            assert_same_info(computed, info)


def test_targets_are_the_images_that_the_toolkit_would_choose(dataset):
    """As its enumerate_test_targets.py."""
    expected = [
        {"scene_id": scene_id, "im_id": int(image), "obj_id": 1, "inst_count": 1}
        for scene_id, scene in scenes(dataset)
        for image, (info,) in json.loads((scene / "scene_gt_info.json").read_text()).items()
        if info["visib_fract"] >= 0.1
    ]
    assert json.loads((dataset / "test_targets_bop19.json").read_text()) == expected
    assert expected


def test_info_of_the_models_is_what_the_toolkit_computes_and_tells_where_the_box_is(dataset):
    """As its calc_model_info.py; readers of symmetries find none."""
    mesh, _ = read_mesh(dataset / "models" / "obj_000001.ply")
    for folder in ("models", "models_eval"):
        ((key, info),) = json.loads((dataset / folder / "models_info.json").read_text()).items()
        assert key == "1"
        low, size = (np.array([info[f"{name}_{axis}"] for axis in "xyz"]) for name in ("min", "size"))
        np.testing.assert_allclose(low, mesh.vertices.min(axis=0), atol=1e-5)
        np.testing.assert_allclose(size, np.ptp(mesh.vertices, axis=0), atol=1e-5)
        np.testing.assert_allclose(info["box_centre_mm"], low + size / 2, atol=1e-9)
        furthest = np.linalg.norm(mesh.vertices[:, None] - mesh.vertices[None], axis=2).max()
        assert info["diameter"] == pytest.approx(furthest, rel=1e-6)


RENDERER = """
import numpy as np
from tests.outside.test_foreign_readers import depth_of_model
class Renderer:
    def __init__(self, size): self.size = size
    def add_object(self, obj_id, path): self.path = path
    def render_object(self, obj_id, R, t, fx, fy, cx, cy):
        from pathlib import Path
        from oneframe.transforms import rigid
        width, height = (side // 3 for side in self.size)
        k = np.array([[fx, 0, cx - width], [0, fy, cy - height], [0, 0, 1]])
        return {"depth": depth_of_model(Path(self.path).parents[1], k, rigid(R, t.ravel()), (width, height))}
def create_renderer(width, height, renderer_type, mode): return Renderer((width, height))
"""
"""Takes the place of the toolkit's renderer, which needs OpenGL."""

LOADER = """
import json, sys
import numpy as np
from bop_toolkit_lib import dataset_params, inout
root = sys.argv[1]
split = dataset_params.get_split_params(root, "NAME", "train", "synt")
models = dataset_params.get_model_params(root, "NAME")
camera = dataset_params.get_camera_params(root, "NAME")
found = {"scenes": dataset_params.get_present_scene_ids(split), "images": 0, "camera": list(camera["im_size"])}
assert found["scenes"] == split["scene_ids"] and tuple(camera["im_size"]) == split["im_size"]
for scene_id in found["scenes"]:
    cameras = inout.load_scene_camera(split["scene_camera_tpath"].format(scene_id=scene_id))
    for im_id, (truth,) in inout.load_scene_gt(split["scene_gt_tpath"].format(scene_id=scene_id)).items():
        names = {"scene_id": scene_id, "im_id": im_id, "gt_id": 0}
        depth = inout.load_depth(split["depth_tpath"].format(**names)) * cameras[im_id]["depth_scale"]
        mask = inout.load_im(split["mask_visib_tpath"].format(**names))
        assert inout.load_im(split["rgb_tpath"].format(**names)).shape == (*depth.shape, 3)
        assert ((depth > 0) == (mask > 0)).all() and truth["cam_t_m2c"].shape == (3, 1)
        found["images"] += 1
for model_type in (None, "eval"):
    path = dataset_params.get_model_params(root, "NAME", model_type)["model_tpath"].format(obj_id=models["obj_ids"][0])
    model = inout.load_ply(path)
    assert np.isfinite(model["pts"]).all() and len(model["normals"]) == len(model["pts"])
    assert ("colors" in model) == (model_type is None)
print(json.dumps(found))
"""


def own_toolkit(checkout: Path, dataset: Path, folder: Path) -> Path:
    """A copy of a checkout with the entries that ``dataset_info.md`` asks for, and without its renderer."""
    copied = folder / "toolkit"
    shutil.copytree(checkout, copied, ignore=shutil.ignore_patterns(".git"))
    (copied / "bop_toolkit_lib" / "renderer.py").write_text(RENDERER)
    told = (dataset / "dataset_info.md").read_text(encoding="utf-8")
    snippet = re.search(r"```python\n(.*?)```", told, re.DOTALL)[1]
    (ids, symmetric), branch = (
        re.findall(r'^"NAME".*$', snippet, re.MULTILINE),
        re.search(r"elif.*", snippet, re.DOTALL)[0],
    )
    params = copied / "bop_toolkit_lib" / "dataset_params.py"
    text = params.read_text()
    text = text.replace("    obj_ids = {", f"    obj_ids = {{\n        {ids}", 1)
    text = text.replace("    symmetric_obj_ids = {", f"    symmetric_obj_ids = {{\n        {symmetric}", 1)
    indented = "".join(f"    {line}\n" for line in branch.splitlines())
    params.write_text(
        re.sub(r"(?m)^    else:\n\s+raise ValueError\(\"Unknown BOP", lambda m: indented + m[0], text, count=1)
    )
    return copied


def test_the_toolkit_itself(dataset, tmp_path, long_form):
    """Its loader, calc_gt_info.py and calc_gt_coco.py, run on a copy, give our tables."""
    if not long_form:
        pytest.skip("only with --long")
    if "BOP_TOOLKIT" not in os.environ:
        pytest.skip("the environment variable BOP_TOOLKIT names no checkout of thodan/bop_toolkit")
    pytest.importorskip("imageio")
    root = tmp_path / "datasets"
    shutil.copytree(dataset, root / "NAME")
    toolkit = own_toolkit(Path(os.environ["BOP_TOOLKIT"]), dataset, tmp_path)
    for scene in (root / "NAME" / "train_synt").iterdir():
        (scene / "scene_gt_coco.json").unlink()
    script = toolkit / "scripts" / "calc_gt_info.py"
    settings = {"dataset": "NAME", "dataset_split": "train", "dataset_split_type": "synt", "datasets_path": str(root)}
    text = script.read_text()
    for key, value in {**settings, "modality": None, "sensor": None}.items():
        text = re.sub(rf'(?m)^(\s+"{key}": ).*$', lambda m, value=value: f"{m[1]}{value!r},", text, count=1)
    script.write_text(text)
    paths = os.pathsep.join([str(toolkit), str(Path(__file__).parents[2])])

    def run(*arguments: object) -> str:
        ended = subprocess.run(
            [sys.executable, *map(str, arguments)], capture_output=True, text=True, check=False,
            env=os.environ | {"PYTHONPATH": paths},
        )  # fmt: skip
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    found = json.loads(run("-c", LOADER, root).splitlines()[-1])
    assert found["images"] == json.loads((dataset / "dataset.json").read_text())["count"]
    run(script)
    arguments = [part for key, value in settings.items() for part in (f"--{key}", value)]
    run(toolkit / "scripts" / "calc_gt_coco.py", *arguments, "--use_all_gt")
    for scene_id, scene in scenes(dataset):
        theirs = root / "NAME" / "train_synt" / f"{scene_id:06d}"
        ours = json.loads((scene / "scene_gt_info.json").read_text())
        for image, (info,) in json.loads((theirs / "scene_gt_info.json").read_text()).items():
            assert_same_info(info, ours[image][0])
        coder = pytest.importorskip("pycocotools.mask")
        coco, their_coco = (json.loads((path / "scene_gt_coco.json").read_text()) for path in (scene, theirs))
        assert [image["file_name"] for image in their_coco["images"]] == [
            image["file_name"] for image in coco["images"]
        ]
        assert len(their_coco["annotations"]) == len(coco["annotations"]) > 0
        for their, our in zip(their_coco["annotations"], coco["annotations"], strict=True):
            for key in ("image_id", "category_id", "iscrowd", "area", "bbox", "width", "height", "ignore"):
                assert their[key] == our[key]
            height, width = our["segmentation"]["size"]
            code = coder.frPyObjects(their["segmentation"], height, width)
            np.testing.assert_array_equal(coder.decode(code), coder.decode(our["segmentation"]))


# --- Nerfstudio


def test_rays_and_depths_of_nerfstudio_meet_the_model(ray_cast_dataset):
    """With the options in ``dataset_info.md``: depth in the scene's unit, the surface inside its box, masks white."""
    parsers = pytest.importorskip("nerfstudio.data.dataparsers.nerfstudio_dataparser", exc_type=ImportError)
    datasets = pytest.importorskip("nerfstudio.data.datasets.depth_dataset", exc_type=ImportError)
    told = (ray_cast_dataset / "dataset_info.md").read_text(encoding="utf-8")
    scale, centre = (re.search(rf"--{name} (\S+)", told)[1] for name in ("depth-unit-scale-factor", "center-method"))
    config = parsers.NerfstudioDataParserConfig(
        data=ray_cast_dataset, depth_unit_scale_factor=float(scale), center_method=centre
    )
    mesh, _ = read_mesh(ray_cast_dataset / "models" / "obj_000001.ply")
    description = json.loads((ray_cast_dataset / "dataset.json").read_text())["camera"]
    camera = PinholeCamera(**{name: description[name] for name in ("width", "height", "fx", "fy", "cx", "cy")})
    poses = {}
    for _, scene in scenes(ray_cast_dataset):
        for image, (truth,) in json.loads((scene / "scene_gt.json").read_text()).items():
            rotation = np.reshape(truth["cam_R_m2c"], (3, 3))
            poses[scene.name, int(image)] = rigid(rotation, truth["cam_t_m2c"])
    seen = 0
    for split in ("train", "val"):
        parsed = config.setup().get_dataparser_outputs(split)
        read = datasets.DepthDataset(parsed)
        transform = np.vstack([parsed.dataparser_transform.numpy().astype(float), [0, 0, 0, 1]])
        for number, path in enumerate(parsed.image_filenames):
            data = read.get_data(number)
            mask, z = data["mask"].numpy()[..., 0], data["depth_image"].numpy()[..., 0].astype(float)
            assert data["image"].shape[:2] == mask.shape == camera.shape_hw
            rows, columns = mask.nonzero()
            rays = parsed.cameras.generate_rays(camera_indices=number)
            along = (rays.directions * rays.metadata["directions_norm"]).numpy().astype(float)
            points = rays.origins.numpy() + along * z[..., None]
            assert np.abs(points[mask]).max() < 1
            assert np.abs(points[mask].mean(axis=0)).max() < 0.3
            inverse = np.linalg.inv(transform)
            model = points[mask] / parsed.dataparser_scale @ inverse[:3, :3].T + inverse[:3, 3]
            pose = poses[path.parent.parent.name, int(path.stem)]
            depth, _ = intersect(mesh, camera, pose, np.stack([columns, rows], -1).astype(float))
            rays_cam = camera.rays_cam(np.stack([columns, rows], -1).astype(float))
            expected = (rays_cam * depth[:, None] - pose[:3, 3]) @ pose[:3, :3]
            hit = depth > 0
            assert hit.mean() > 0.98
            # half a unit of the depth image and single precision
            assert np.linalg.norm(model - expected, axis=1)[hit].max() < 0.02
            outside = np.argwhere(~mask)[::7, ::-1].astype(float)
            assert (intersect(mesh, camera, pose, outside)[0] > 0).mean() < 0.02
            seen += 1
    assert seen == len(poses)
