"""Whatever is changed in a finished dataset is found, and a dataset that nobody changed has no findings.

A change of one file is found by the plain check. Where every hash and table is made again, the dataset is rendered
again from its case.
"""

import copy
import io
import json
import os
import shutil
from collections.abc import Callable, Iterator
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
from oneframe.dataset.bop import is_test_target, write_models, write_scene, write_test_targets
from oneframe.dataset.check.check_dataset import CheckReport, check_dataset
from oneframe.dataset.check.rerendered import Rerendering
from oneframe.dataset.folder import Shard
from oneframe.dataset.identity import geometry_hash
from oneframe.dataset.layout import SPLIT, ViewPaths
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.pose_tables import write_poses
from oneframe.dataset.view_record import read_record
from oneframe.errors import InputError
from oneframe.images.contact_sheet import contact_sheet
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_reader import read_mesh
from oneframe.video.frame_reader import read_video_frame
from tests.dataset.sealing import sealed

pytestmark = pytest.mark.render

VIEWS, FRAMES, SEED = 6, 8, 20
OPTIONS = DatasetOptions(count=VIEWS, seed=3, float_depth=True, video=True, video_frames=FRAMES)
SCENE = f"{SPLIT}/000000"
MODEL = "models/obj_000001.ply"
BESIDE = (
    "dataset.json", "checksums.json", "camera.json", "poses.csv", "transforms.json", "test_targets_bop19.json",
    "dataset_info.md", "contact_sheet.png", "overlay.png", MODEL, "models/models_info.json",
    "models_eval/obj_000001.ply", "models_eval/models_info.json", "video/trajectory.mp4", "video/poses.csv",
    *(f"{SCENE}/scene_{name}.json" for name in ("camera", "gt", "gt_info", "gt_coco")),
)  # fmt: skip
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
    "anti-aliased": replace(OPTIONS, samples=4, video=False),
    "texture": replace(OPTIONS, colour="texture", video=False),
    "trajectory": replace(OPTIONS, sampler="trajectory", video=False),
    "eevee": replace(OPTIONS, engine="eevee", count=2, video_frames=2),
    "raster": replace(OPTIONS, engine="raster"),
    "raster, anti-aliased": replace(OPTIONS, engine="raster", colour="texture", unseen="fill", samples=4, video=False),
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


# --- one file is changed, and nothing else


def flip(path: Path, rng: np.random.Generator) -> None:
    data = bytearray(path.read_bytes())
    data[rng.integers(len(data))] ^= 1 << rng.integers(7)
    path.write_bytes(data)


def append(path: Path, rng: np.random.Generator) -> None:
    path.write_bytes(path.read_bytes() + rng.bytes(3))


DAMAGES: dict[str, Callable[[Path, np.random.Generator], object]] = {
    "flipped bit": flip,
    "cut off": lambda path, rng: os.truncate(path, int(rng.integers(1, path.stat().st_size - 1))),
    "zeros": lambda path, rng: path.write_bytes(bytes(path.stat().st_size)),
    "empty": lambda path, rng: path.write_bytes(b""),
    "longer": append,
    "deleted": lambda path, rng: path.unlink(),
    "a folder": lambda path, rng: (path.unlink(), path.mkdir()),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_any_damage_to_any_file_is_found(copies, long_form, damage):
    rng = np.random.default_rng([SEED, list(DAMAGES).index(damage)])
    names = np.array([*BESIDE, *(ViewPaths(Path(), 1).relative(kind) for kind in KINDS)])
    missed = []
    for _ in range(10 if long_form else 1):
        for name in names if long_form else rng.choice(names, len(names) // 2, replace=False):
            root = copies()
            before = (root / name).read_bytes()
            DAMAGES[damage](root / name, rng)
            if not is_found(root) and not (name == "checksums.json" and _same_json(before, root / name)):
                missed.append(name)
    assert missed == []


def _same_json(before: bytes, path: Path) -> bool:
    """Whether only white space has changed: of the file that no other vouches for, this is all that may."""
    return json.loads(before) == json.loads(path.read_bytes())


def swap(one: Path, other: Path) -> None:
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)


def test_files_that_are_swapped_copied_or_added_are_found(copies, untouched):
    views = [{kind: ViewPaths(Path(), index).relative(kind) for kind in KINDS} for index in (1, 4)]
    pairs = [(views[0][kind], views[1][kind]) for kind in KINDS if kind != "mask"]
    pairs += [("contact_sheet.png", "overlay.png"), ("models/models_info.json", "camera.json")]
    missed = []
    for one, other in pairs:
        root = copies()
        swap(root / one, root / other)
        missed += [] if is_found(root) else [f"{one} swapped with {other}"]
        shutil.copy(untouched / one, root / other)
        shutil.copy(untouched / one, root / one)
        missed += [] if is_found(root) else [f"{one} copied to {other}"]
    added = [
        f"{SCENE}/rgb/000006.png", f"{SCENE}/frame/000007.json", f"{SCENE}/rgb/000001.jpg", f"{SCENE}/notes.json",
        f"{SCENE}/rgb/deeper/000001.png", f"{SPLIT}/000001/rgb/000000.png", "test_primesense/000001/rgb/000000.png",
        "models/obj_000002.ply", "models/obj_000001.png", "models_eval/obj_000002.ply", "transforms_train.json",
        "camera_tless.json", "video/second.mp4", "poses.npy", "train_pbr/000000/scene_gt.json", f"{SPLIT}/poses.csv",
    ]  # fmt: skip
    for name in added:
        root = copies()
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(root / "overlay.png", root / name)
        missed += [] if is_found(root) else [f"{name} added"]
    assert missed == []
    # what people put beside a dataset is no part of it
    root = copies()
    for name in ("README.md", "LICENSE", ".gitattributes", "notes.txt", f"{SCENE}/.DS_Store"):
        (root / name).write_text("mine")
    assert not is_found(root)


# --- a value is changed, and perhaps all hashes with it

Place = tuple[str | int, ...]


def places(content: object, place: Place = ()) -> Iterator[Place]:
    """Where the values of a JSON document are."""
    if isinstance(content, dict | list) and content:
        for key, value in content.items() if isinstance(content, dict) else enumerate(content):
            yield from places(value, (*place, key))
    else:
        yield place


def other_value(value: object) -> object:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1 if isinstance(value, int) else value * 1.001 + 1e-3
    return value + "x" if isinstance(value, str) else {"added": 1}


def edited(content: object, place: Place, change: str) -> object:
    """The document with another value at a place, without it, or with a key beside it."""
    content = copy.deepcopy(content)
    table = content
    for key in place[:-1]:
        table = table[key]
    if change == "changed":
        table[place[-1]] = other_value(table[place[-1]])
    elif change == "deleted":
        del table[place[-1]]
    elif isinstance(table, dict):
        table["added"] = 1
    else:
        table.append(copy.deepcopy(table[-1]))
    return content


def write(path: Path, content: object) -> None:
    path.write_text(json.dumps(content))


def some_places(path: Path, count: int, rng: np.random.Generator) -> list[Place]:
    found = list(places(json.loads(path.read_text())))
    return found if count >= len(found) else [found[i] for i in sorted(rng.choice(len(found), count, replace=False))]


TABLES = [name for name in BESIDE if name.endswith(".json")]
RECORD = ViewPaths(Path(), 1).relative("frame")
BY_SEALING = {"identity", "files"}
"""What sealing a dataset writes into its records."""


@pytest.mark.parametrize("change", ["changed", "deleted", "added"])
def test_any_change_of_a_json_value_is_found(copies, untouched, long_form, change):
    """Also with all hashes made again, except for what only the case can tell: see the tests below."""
    rng = np.random.default_rng(SEED)
    missed = []
    for name in (*TABLES, RECORD):
        for place in some_places(untouched / name, 10**9 if long_form else 2, rng):
            content = edited(json.loads((untouched / name).read_text()), place, change)
            root = copies()
            write(root / name, content)
            missed += [] if is_found(root) else [f"{name}: {place}"]
            by_sealing = name == "checksums.json" or (name == RECORD and place[0] in BY_SEALING)
            beyond = name == "dataset.json" or (name == RECORD and place[0] == "rejections")
            if not by_sealing and not (beyond and change == "changed") and name != "checksums.json":
                missed += [] if is_found(sealed(root)) else [f"{name}: {place}, sealed"]
    assert missed == []


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
    mesh, _ = read_mesh(root / MODEL)
    depth_scale = json.loads((root / "camera.json").read_text())["depth_scale"]
    records = [read_record(ViewPaths(root, index)) for index in range(VIEWS)]
    write_scene(root, records, intrinsics, content["object"])
    mesh_from_model = np.array(content["mesh_from_model"])
    write_poses(root, records, intrinsics, mesh_from_model, bounds=mesh.bounds, depth_scale=depth_scale)
    write_test_targets(root, [record.index for record in records if is_test_target(record)])
    images = [image_of(root, index, "rgb") / 255 for index in range(VIEWS)]
    (root / "contact_sheet.png").write_bytes(encode_png(to_uint8(contact_sheet(images, columns=6, tile_width=240))))
    return sealed(root)


def ply_values(path: Path) -> tuple[int, np.ndarray]:
    """Size of the header, and the vertices as ``(V, 27)`` bytes."""
    data = path.read_bytes()
    start = data.index(b"end_header\n") + len(b"end_header\n")
    count = int(data.split(b"element vertex ")[1].split()[0])
    return start, np.frombuffer(data, np.uint8, 27 * count, start).reshape(count, 27).copy()


def change_colours(root: Path) -> None:
    start, vertices = ply_values(root / MODEL)
    vertices[:, 24:] = 255 - vertices[:, 24:]
    data = (root / MODEL).read_bytes()
    (root / MODEL).write_bytes(data[:start] + vertices.tobytes() + data[start + vertices.size :])


def move_vertex(root: Path) -> None:
    """Move a vertex by 2 mm; normals, the reduced model and the geometry's hash follow."""
    _, vertices = ply_values(root / MODEL)
    mesh, _ = read_mesh(root / MODEL)
    mesh.vertices[int(np.argmin(np.linalg.norm(mesh.vertices[:, :2], axis=1))), 2] += 2
    moved = TriangleMesh(mesh.vertices - mesh.vertices.mean(axis=0), mesh.faces)
    write_models(root, moved, vertices[:, 24:])
    content = json.loads((root / "dataset.json").read_text())
    write(root / "dataset.json", content | {"geometry_sha256": geometry_hash(moved)})


def replace_rgb(root: Path) -> None:
    image = image_of(root, 2, "rgb")
    ViewPaths(root, 2).file("rgb").write_bytes(encode_png(np.ascontiguousarray(image[..., ::-1])))


def darken_one_code(root: Path) -> None:
    image = image_of(root, 5, "rgb")
    image[20, 30] -= image[20, 30] > 0
    ViewPaths(root, 5).file("rgb").write_bytes(encode_png(np.ascontiguousarray(image)))


def copy_view(root: Path) -> None:
    """View 1 once more under the number 4."""
    one, other = ViewPaths(root, 1), ViewPaths(root, 4)
    for kind in KINDS[:-1]:
        shutil.copy(one.file(kind), other.file(kind))
    text = one.file("frame").read_text()
    other.file("frame").write_text(text.replace("000001.", "000004.").replace("000001_", "000004_"))


def see_more(root: Path) -> None:
    """All of the surface in view 3 was seen by the frame."""
    mask = image_of(root, 3, "mask")
    ViewPaths(root, 3).file("mask_observed").write_bytes(encode_png(mask))
    record = ViewPaths(root, 3).file("frame")
    write(record, json.loads(record.read_text()) | {"px_count_observed": int((mask > 0).sum())})


def other_video(root: Path) -> None:
    frames = [read_video_frame(root / "video/trajectory.mp4", index) for index in range(FRAMES)]
    write_video(root / "video/trajectory.mp4", (frame[..., ::-1] / 255 for frame in frames))


def swap_video_poses(root: Path) -> None:
    header, *rows = (root / "video/poses.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    cells[1][2:], cells[5][2:] = cells[5][2:], cells[1][2:]
    (root / "video/poses.csv").write_text("\n".join([header, *(",".join(row) for row in cells)]) + "\n")


CONTENT = {
    "colours of the model": (change_colours, False),
    "a vertex by 2 mm, and all that follows": (move_vertex, True),
    "an RGB image": (replace_rgb, False),
    "a pixel by one code": (darken_one_code, False),
    "a view twice": (copy_view, True),
    "a mask of the seen": (see_more, False),
    "the video": (other_video, False),
    "poses of the video": (swap_video_poses, False),
}
"""Change of the content -> whether the plain check finds it with every table and hash made again."""


@pytest.mark.parametrize("name", CONTENT)
def test_changed_content_is_found_even_if_everything_is_made_again(copies, case, name):
    change, without_case = CONTENT[name]
    root = copies()
    change(root)
    assert is_found(root)
    tables_again(root)
    report = checked(root)
    assert bool(report.findings) == without_case, report.findings.shown()
    assert is_found(root, case)


def test_a_dataset_of_another_seed_is_told_from_this_one_view_by_view(copies, case, tmp_path):
    """A shard of another run, copied over."""
    other = render(case, tmp_path / "other", replace(OPTIONS, seed=4, video=False))
    root = copies()
    for kind in KINDS:
        shutil.copy(ViewPaths(other, 2).file(kind), ViewPaths(root, 2).file(kind))
    assert any("the view is of another run" in line for line in checked(root).findings.shown())


def test_the_case_must_be_the_one_that_was_rendered(untouched, case, tmp_path):
    folder = tmp_path / "case"
    shutil.copytree(case.parent, folder)
    image = cv2.imread(str(folder / "frame.png"))
    (folder / "frame.png").write_bytes(encode_png(np.ascontiguousarray(image[::-1])))
    report = check_dataset(untouched, case=read_case(folder / case.name), stream=io.StringIO())
    (finding,) = report.findings.shown()
    assert finding == f"dataset.json: inputs_sha256: {folder / 'frame.png'} is not the frame of the dataset"
