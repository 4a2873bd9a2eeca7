"""The command as a user starts it: a surface, a frame, a mask and K in; a folder out that all others take unchanged."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.case.case_file import read_case
from oneframe.case.loaded_case import load_case
from oneframe.case.pose_record import PoseRecord
from oneframe.commands.__main__ import dispatch
from oneframe.errors import InputError
from oneframe.images.image_reader import read_image
from oneframe.images.png import encode_png
from oneframe.surface.mesh_reader import read_mesh
from oneframe.surface.mesh_writer import write_obj, write_ply
from tests.tree import tree
from tests.volume.ball_ct import write_ball_ct

SECRET = "ZQXDOE"
WIDTH, HEIGHT = 96, 72
K = {"fx": 900.0, "fy": 905.0, "cx": 47.0, "cy": 36.5, "width": WIDTH, "height": HEIGHT}
DISTORTION = [0.1, -0.05, 0.001, 0.0, 0.0]


def frame_codes(largest: int) -> np.ndarray:
    """``(H, W, 3)`` codes with all depths in them."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    codes = np.stack([(u * 37 + v * 11) % 256, (u * v) % 256, 255 - (u + v)], -1)
    return (codes * (largest // 255) + (codes % 7 if largest > 255 else 0)).astype(
        np.uint16 if largest > 255 else np.uint8
    )


@pytest.fixture(scope="module")
def surface(tmp_path_factory) -> Path:
    """What ``oneframe surface`` leaves of a ball of bone with a drilled bowl, 9 mm deep, and a nerve behind it."""
    folder = tmp_path_factory.mktemp("ct")
    write_ball_ct(folder)
    # the bowl opens to the left, +x
    (folder / "plan.toml").write_text(
        "[[strokes]]\nradius_mm = 4.0\npoints_mm = [[-9.0, 51.5, 911.0], [-14.0, 51.5, 911.0]]\n"
    )
    line = ["surface", folder / "ct.nii.gz", "--labels", folder / "labels.nii.gz", "--drill", folder / "plan.toml"]
    assert dispatch([*map(str, line), "--out", str(folder / "surface")]) == 0
    return folder / "surface"


@pytest.fixture
def given(surface, tmp_path) -> Path:
    """Everything that a user has, in one folder; the names and metadata of some files name somebody."""
    folder = tmp_path / "given"
    shutil.copytree(surface, folder / "surface")
    frame = cv2.imencode(".png", frame_codes(255)[..., ::-1])[1].tobytes()
    text = b"tEXt" + b"Author\0" + SECRET.encode()
    chunk = (len(text) - 4).to_bytes(4, "big") + text + __import__("zlib").crc32(text).to_bytes(4, "big")
    (folder / f"{SECRET}.png").write_bytes(frame[:33] + chunk + frame[33:])
    mask = np.ones((HEIGHT, WIDTH), np.uint8)
    mask[:10] = 0
    (folder / "mask.png").write_bytes(encode_png(mask))
    (folder / "camera.json").write_text(json.dumps(K | {"distortion": DISTORTION}))
    return folder


def line(given: Path, **changed: object) -> list[str]:
    """The command's arguments; ``None`` leaves an option out, and an underscore stands for a hyphen."""
    options = {"surface": given / "surface", "frame": given / f"{SECRET}.png", "camera": given / "camera.json"}
    options |= {"out": given.parent / "case"} | changed
    words = [["--" + name.replace("_", "-"), value] for name, value in options.items() if value is not None]
    return [
        "case",
        *(
            str(part)
            for name, value in words
            for part in (
                [name, *value] if isinstance(value, list | tuple) else [name] if value is True else [name, value]
            )
        ),
    ]


@pytest.mark.render
def test_the_folder_is_a_case_that_every_command_takes(given, tmp_path, run_oneframe):
    before = tree(given)
    ended = run_oneframe(*line(given, mask=given / "mask.png"))
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "initial guess" in ended.stdout
    assert f"{10 / HEIGHT:.1%} masked" in ended.stdout
    out = tmp_path / "case"
    assert "oneframe align " + str(out / "case.toml") in ended.stdout
    assert tree(given) == before

    names = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert names == {"case.toml", "frame.png", "overlay.png", "surface.ply", "structures/facial_nerve.ply"}
    for name in ("surface.ply", "structures/facial_nerve.ply"):
        assert (out / name).read_bytes() == (given / "surface" / name).read_bytes()
    for path in out.rglob("*"):
        assert SECRET not in path.name
        assert path.is_dir() or SECRET.encode() not in path.read_bytes()

    loaded = load_case(read_case(out / "case.toml"))
    assert loaded.messages == ()
    (structure,) = loaded.case.structures
    assert (structure.name, structure.colour) == ("facial_nerve", (1.0, 0.0, 1.0))
    assert (loaded.frame.camera.fx, loaded.frame.camera.cy) == (900.0, 36.5)
    assert loaded.case.distortion.k1 == 0.1
    assert loaded.case.alignment == PoseRecord("initial guess")
    colours, shown = read_image(out / "frame.png")
    assert np.array_equal(np.rint(colours * 255), frame_codes(255))
    assert shown[10:].all()
    assert not shown[:10].any()
    # into the bowl, from where it is open, with the head up
    assert loaded.frame.cam_from_model[2, 0] < -0.95
    assert loaded.frame.cam_from_model[1, 2] < -0.95

    rendered = run_oneframe("render", out / "case.toml", "--out", tmp_path / "dataset", "--count", 2)
    assert rendered.returncode == 0, rendered.stderr
    assert rendered.stdout.startswith("note: the pose of case.toml is an initial guess that nobody has aligned")
    checked = run_oneframe("check", tmp_path / "dataset")
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_a_second_run_replaces_the_first_until_somebody_changes_it(given, tmp_path):
    out = tmp_path / "case"
    assert dispatch(line(given)) == 0
    first = tree(out)
    assert dispatch(line(given)) == 0
    assert tree(out) == first
    with pytest.raises(InputError, match=r"frame.png: expected no such file or that of this case, .* --overwrite"):
        dispatch(line(given, mask=given / "mask.png"))
    assert tree(out) == first
    assert dispatch(line(given, mask=given / "mask.png", overwrite=True)) == 0
    masked = tree(out)
    (frame,) = out.glob("frame-*.png")
    assert first.keys() - masked.keys() == {"frame.png"}
    assert masked.keys() - first.keys() == {frame.name}
    changed = {Path(name).name for name in masked.keys() & first.keys() if first[name] != masked[name]}
    assert changed == {"case.toml", "overlay.png"}
    assert dispatch(line(given, mask=given / "mask.png")) == 0
    assert tree(out) == masked
    assert dispatch(line(given, overwrite=True)) == 0
    assert tree(out) == first
    for name in ("case.toml", "frame.png", "surface.ply"):
        text = (out / name).read_bytes()
        (out / name).write_bytes(text.replace(b"guess", b"align") if name == "case.toml" else text[:-1])
        kept = tree(out)
        with pytest.raises(InputError, match=f"{name}: expected no such file or that of this case"):
            dispatch(line(given))
        assert tree(out) == kept
        (out / name).write_bytes(text)


def test_a_case_in_the_folder_of_the_surface(given):
    """What is there already stays there; an input that would become another file is refused."""
    folder = given / "surface"
    before = tree(folder)
    assert dispatch(line(given, out=folder)) == 0
    after = tree(folder)
    assert after.items() >= before.items()
    assert {Path(name).name for name in after.keys() - before.keys()} == {"case.toml", "frame.png", "overlay.png"}
    assert dispatch(line(given, out=folder, frame=folder / "frame.png")) == 0
    assert tree(folder) == after
    with pytest.raises(InputError, match="found the frame"):
        dispatch(line(given, out=folder, frame=folder / "frame.png", mask=given / "mask.png"))
    assert tree(folder) == after


@pytest.mark.parametrize("kind", ["png16", "jpeg", "rgba"])
def test_the_colours_are_those_that_blender_reads(given, tmp_path, kind):
    codes = frame_codes(65535 if "16" in kind else 255)
    path = given / ("frame." + {"jpeg": "jpg"}.get(kind, "png"))
    if kind == "rgba":
        alpha = np.full((HEIGHT, WIDTH), 255, np.uint8)
        # some of the frame's own, and half a transparency that shows the surface
        alpha[:, :20], alpha[:, 20:25] = 0, 128
        codes = np.dstack([codes, alpha])
    cv2.imwrite(str(path), codes[..., [2, 1, 0, 3][: codes.shape[2]]])
    before, own = read_image(path)
    assert dispatch(line(given, frame=path, mask=given / "mask.png")) == 0
    after, shown = read_image(tmp_path / "case" / "frame.png")
    scale = 65535 if "16" in kind else 255
    assert np.array_equal(np.rint(after * scale), np.rint(before * scale))
    mask = np.arange(HEIGHT)[:, None] >= 10
    assert np.array_equal(shown, own & mask)
    assert own.all() == (kind != "rgba")


def test_k_of_another_size_is_refused_with_the_factor_or_rescaled(given, tmp_path):
    (given / "camera.json").write_text(
        json.dumps(K | {"width": 2 * WIDTH, "height": 2 * HEIGHT, "cx": 95.5, "cy": 71.5})
    )
    with pytest.raises(
        InputError,
        match=r"192x144 px, this image has 96x72: if one is the other resized, .* rescale K by 0.5 with --resc",
    ):
        dispatch(line(given))
    assert not (tmp_path / "case").exists()
    assert dispatch(line(given, rescale_camera=True)) == 0
    camera = read_case(tmp_path / "case" / "case.toml").camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy, camera.size_wh) == (450, 452.5, 47.5, 35.5, (WIDTH, HEIGHT))
    # typed, it is the same
    typed = {"camera": None, "K": [450, 452.5, 47.5, 35.5]}
    assert dispatch(line(given, **typed, out=tmp_path / "typed")) == 0
    assert read_case(tmp_path / "typed" / "case.toml").camera == camera
    (given / "camera.json").write_text(json.dumps(K | {"width": 200}))
    for rescale in (None, True):
        with pytest.raises(InputError, match="another aspect ratio"):
            dispatch(line(given, rescale_camera=rescale))


def test_meshes_of_others_in_metres_with_a_pose(given, tmp_path, capfd):
    mesh, _ = read_mesh(given / "surface" / "surface.ply")
    nerve, _ = read_mesh(given / "surface" / "structures" / "facial_nerve.ply")
    write_obj(given / "bone.obj", mesh.scaled(0.001))
    (given / "bone.obj").write_text(f"# {SECRET}\n" + (given / "bone.obj").read_text())
    write_ply(given / "vii.ply", nerve.scaled(0.001))
    write_ply(given / "ras.ply", nerve.moved(-2 * nerve.vertices.mean(axis=0) * [1, 1, 0]).scaled(0.001))
    write_ply(given / "mm.ply", nerve)
    pose = np.eye(4)
    pose[:3, :3] = [[0, 1, 0], [0, 0, -1], [-1, 0, 0]]
    pose[:3, 3] = -pose[:3, :3] @ mesh.vertices.mean(axis=0) + [0, 0, 200]
    np.savetxt(given / "pose.txt", np.vstack([np.column_stack([pose[:3, :3], pose[:3, 3] / 1000]), [0, 0, 0, 1]]))
    meshes = {"surface": given / "bone.obj", "units": "m", "pose": given / "pose.txt"}
    words = line(given, **meshes)
    for name in ("vii.ply", "chorda=ras.ply", "incus=mm.ply"):
        words += ["--structure", name.replace("=", f"={given}/") if "=" in name else str(given / name)]
    assert dispatch(words) == 0
    said = capfd.readouterr().out.splitlines()
    (ras,) = (text for text in said if text.startswith("warning: chorda"))
    assert "mm outside" in ras
    assert "from RAS to LPS" in ras
    (large,) = (text for text in said if text.startswith("warning: incus"))
    assert "in millimetres it would be in place" in large
    assert not [text for text in said if "structure_1" in text and "warning" in text]
    case = read_case(tmp_path / "case" / "case.toml")
    assert case.mm_per_unit == 1000
    np.testing.assert_allclose(case.cam_from_mesh, pose, atol=1e-9)
    assert case.alignment == PoseRecord()
    assert {each.name: each.colour for each in case.structures}["chorda"] == (0, 1, 0)
    loaded = load_case(case)
    np.testing.assert_allclose(
        np.sort(loaded.surface.mesh.bounds, axis=0), mesh.moved(-mesh.vertices.mean(axis=0)).bounds, atol=1e-4
    )
    assert SECRET.encode() not in b"".join(path.read_bytes() for path in case.path.parent.glob("*.*"))


def break_record(given: Path, change) -> None:
    path = given / "surface" / "surface.json"
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))


def save(path: Path, codes: np.ndarray) -> Path:
    cv2.imwrite(str(path), codes)
    return path


WRONG = {
    "mask of another size": (
        lambda given: {"mask": save(given / "m.png", np.ones((HEIGHT, WIDTH + 1), np.uint8))},
        "m.png: expected a mask of 96x72 px, .*, found 97x72",
    ),
    "mask all zero": (
        lambda given: {"mask": save(given / "m.png", np.zeros((HEIGHT, WIDTH), np.uint8))}, "together they hide all"
    ),
    "frame is a video": (lambda given: {"frame": given / "f.mp4"}, "--frame-number"),
    "frame that EXIF turns": (lambda given: {"frame": turned(given / "f.jpg")}, "EXIF orientation"),
    "a surface that is none": (lambda given: {"surface": given / "camera.json"}, "expected a mesh file"),
    "a report with a file elsewhere": (
        lambda given: break_record(given, lambda record: record["surface"].update(file="../surface/surface.ply")),
        "expected the report of oneframe surface, found something else",
    ),
    "a structure twice": (
        lambda given: {"structure": f"facial_nerve={given}/surface/surface.ply"}, "'facial_nerve' twice"
    ),
}  # fmt: skip


def turned(path: Path) -> Path:
    from PIL import Image

    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(frame_codes(255)).save(path, exif=exif)
    return path


@pytest.mark.parametrize("kind", WRONG)
def test_what_does_not_fit_is_one_sentence_and_nothing_is_written(kind, given, tmp_path):
    change, message = WRONG[kind]
    changed = change(given) or {}
    before = tree(tmp_path)
    with pytest.raises((InputError, RuntimeError), match=message):
        dispatch(line(given, **changed))
    assert tree(tmp_path) == before
    assert not (tmp_path / "case").exists()
