"""Every kind of wrong input: refused with one message that says where and what to do; no files are left behind."""

import dataclasses
import io
import os
import pickle
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.blender.dataset import run as dataset_run
from oneframe.blender.dataset.job import Job, open_job
from oneframe.case.case_file import read_case
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.run_folder import Shard
from oneframe.errors import InputError
from oneframe.images.png import encode_png
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_reader import read_mesh
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import rigid, rotation_from_vector

pytestmark = pytest.mark.render

OPTIONS = DatasetOptions(count=2)
POSE = "[[1, 0, 0, -12], [0, -1, 0, -7], [0, 0, -1, 340], [0, 0, 0, 1]]"
K = "[[320.0, 0, 30.0], [0, 318.0, 25.5], [0, 0, 1]]"


@pytest.fixture
def case(tmp_path, write_tiny_case) -> Path:
    return write_tiny_case(tmp_path / "case")


def opened(case: Path, options: DatasetOptions = OPTIONS) -> object:
    return open_job(Job(read_case(case), case.parent.parent / "out", options, Shard()))


def run_here(case: Path, options: DatasetOptions = OPTIONS) -> str:
    stream = io.StringIO()
    out = case.parent.parent / "out"
    dataset_run.run(Job(read_case(case), out, options, Shard()), workers=1, worker_command=(), stream=stream)
    return stream.getvalue()


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))


def change_mesh(folder: Path, change: Callable[[TriangleMesh], TriangleMesh]) -> None:
    mesh, _ = read_mesh(folder / "surface.ply")
    write_ply(folder / "surface.ply", change(mesh))


# --- the frame ------------------------------------------------------------------------------------------------------


def png_with(data: bytes, width: int = 64, height: int = 48) -> bytes:
    """A grey PNG with correct checksums around any image data."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def jpeg() -> bytes:
    return cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (48, 64, 3)).astype(np.uint8))[1].tobytes()


def flipped_bit(data: bytes) -> bytes:
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


FRAMES = {
    "PNG cut off": (lambda png: png[:-200], "the file is cut off; copy it again"),
    "PNG cut before its end mark": (lambda png: png[:-12], "the file is cut off"),
    "PNG with a wrong bit": (flipped_bit, "expected an image, chunk b'IDAT' is damaged; copy it again"),
    "PNG that cannot be unpacked": (lambda _: png_with(b"no zlib data"), "expected an (intact )?(PNG )?image"),
    "PNG with too few rows": (lambda _: png_with(zlib.compress(bytes(65 * 20))), "expected an (intact )?(PNG )?image"),
    "PNG that takes gigabytes": (
        lambda _: png_with(zlib.compress(bytes(9999)), 20_000, 20_000),
        r"expected an image of at most 25\.0 million pixels, found 20000x20000; crop it or scale it down",
    ),
    "JPEG cut off": (lambda _: jpeg()[:-300], "the file is cut off; copy it again"),
    "JPEG of garbage": (lambda _: b"\xff\xd8" + b"garbage" * 99 + b"\xff\xd9", "expected an image .PNG, JPEG"),
    "TIFF of garbage": (lambda _: b"II*\0" + b"garbage" * 99, "expected an image, its header is cut off or"),
    "another kind of file": (
        lambda _: b"solid mesh",
        "expected an image .*, found a file that starts with b'solid me'",
    ),
    "nothing": (lambda _: b"", "found an empty file"),
}


@pytest.mark.parametrize("what", FRAMES)
def test_bad_frames_are_refused(case, what):
    damage, message = FRAMES[what]
    path = case.parent / "frame.png"
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(InputError, match=rf"^case\.toml: \[frame\] image frame\.png: .*{message}"):
        opened(case)


def test_missing_frames_and_folders_are_refused(case):
    (case.parent / "frame.png").unlink()
    with pytest.raises(InputError, match=r"expected an image file, .*frame\.png does not exist; correct the path"):
        opened(case)
    (case.parent / "frame.png").mkdir()
    with pytest.raises(InputError, match=r"cannot read .*frame\.png \("):
        opened(case)


def test_a_frame_of_another_size_than_the_cameras_is_refused(case):
    (case.parent / "frame.png").write_bytes(encode_png(np.zeros((96, 128, 3), np.uint8)))
    message = r"expected a frame of 64x48 px as in \[camera\] size, frame\.png has 128x96; .*give the K of this image"
    with pytest.raises(InputError, match=message):
        opened(case)


def test_a_complete_jpeg_is_accepted(case):
    (case.parent / "frame.png").write_bytes(jpeg())
    assert opened(case).loaded.image.shape == (48, 64, 3)


# --- the surface ----------------------------------------------------------------------------------------------------


def with_nan(mesh: TriangleMesh) -> TriangleMesh:
    vertices = mesh.vertices.copy()
    vertices[17, 1] = np.nan
    return dataclasses.replace(mesh, vertices=vertices)


MESHES = {
    "cut off": (lambda folder: (folder / "surface.ply").write_bytes((folder / "surface.ply").read_bytes()[:5000]), "."),
    "no mesh": (lambda folder: (folder / "surface.ply").write_bytes(b"\x89PNG\r\n\x1a\n"), "."),
    "empty file": (lambda folder: (folder / "surface.ply").write_bytes(b""), "."),
    "missing": (lambda folder: (folder / "surface.ply").unlink(), "expected a mesh file, it does not exist; correct"),
    "NaN": (lambda folder: change_mesh(folder, with_nan), "found NaN, .* in 1 of 806 vertices .first: vertex 17"),
    "no faces": (
        lambda folder: change_mesh(folder, lambda mesh: dataclasses.replace(mesh, faces=mesh.faces[:0])),
        "expected a surface, found 806 vertices and 0 faces; export the mesh with its faces",
    ),
    "index out of range": (
        lambda folder: change_mesh(folder, lambda mesh: dataclasses.replace(mesh, faces=mesh.faces + 1)),
        r"expected vertex indices 0\.\.805, found 1\.\.806",
    ),
    "all faces flat": (
        lambda folder: change_mesh(folder, lambda mesh: dataclasses.replace(mesh, faces=mesh.faces[:, [0, 0, 1]])),
        "found 1500 faces, all with zero area",
    ),
}


@pytest.mark.parametrize("what", MESHES)
def test_bad_meshes_are_refused(case, what):
    damage, message = MESHES[what]
    damage(case.parent)
    with pytest.raises(InputError, match=rf"surface\.ply.*: .*({message})"):
        opened(case)


def test_faces_without_area_are_dropped_and_reported(case):
    change_mesh(
        case.parent,
        lambda mesh: dataclasses.replace(mesh, faces=np.concatenate([mesh.faces, [[0, 0, 1], [5, 5, 5]]]).astype("i4")),
    )
    assert "surface.ply: dropped 2 of 1502 faces with zero area" in run_here(case)


# --- frame, surface and pose together -------------------------------------------------------------------------------

MISFITS = {
    "behind": (("-1, 340]", "-1, -340]"), "surface in front of the camera, all of it is behind .*mesh_from_cam"),
    "turned away": (
        (POSE, "[[-1, 0, 0, 12], [0, -1, 0, -7], [0, 0, 1, -380], [0, 0, 0, 1]]"),
        "all of it is behind .*negate its 2nd and 3rd row if its axes are OpenGL's",
    ),
    "beside": (
        ("-12]", "150]"),
        r"expected the surface in the frame, it lies (left|right) of the frame.*: u .* of 64x48; align the pose",
    ),
    "a thousand times too far": (("340]", "300000]"), "working distance of 2 mm to 30 m, .*: wrong units suspected"),
    "a thousand times too near": (
        ("[[1, 0, 0, -12], [0, -1, 0, -7], [0, 0, -1, 340]", "[[1, 0, 0, -12], [0, -1, 0, -7], [0, 0, -1, 40.3]"),
        "working distance of 2 mm to 30 m, the surface is .* mm away: wrong units suspected; units is .mm.",
    ),
    "in metres, said to be millimetres": (
        ('units = "mm"', 'units = "m"'),
        "the surface is .*e.05 mm away: wrong units",
    ),
    "units missing": (('units = "mm"\n', ""), "expected a key 'units', it is missing"),
    "a fold": (("[0, 0, 1]]\n", "[0, 0, 1]]\ndistortion = [-30, 0, 0, 0, 0]\n"), "distortion: .*folds it over"),
    "mirrored": ((POSE, POSE.replace("-340", "340").replace("[0, 0, -1,", "[0, 0, 1,")), "found a reflection"),
    "scaled": (("[[1, 0, 0, -12]", "[[1.01, 0, 0, -12]"), r"deviates from orthonormal by 0\.02 \(allowed 0\.01\)"),
    "no focal length": (("[[320.0", "[[-320.0"), "expected positive focal lengths in pixels, found fx = -320"),
    "skewed": ((K, K.replace("320.0, 0,", "320.0, 2,")), "expected no skew, found 2; .*rectify the frame"),
    "K with NaN": ((K, K.replace("30.0", "nan")), "K: expected finite numbers, found NaN"),
    "3x4 pose": ((", [0, 0, 0, 1]]", "]"), r"cam_from_mesh: expected a 4x4 matrix, found shape \(3, 4\)"),
}


@pytest.mark.parametrize("what", MISFITS)
def test_what_does_not_fit_together_is_refused(case, what):
    edits, message = MISFITS[what]
    edit(case, *edits)
    with pytest.raises(InputError, match=rf"^case\.toml: .*{message}"):
        opened(case)


def test_mesh_in_metres_with_a_translation_in_millimetres_is_suspected(case):
    change_mesh(case.parent, lambda mesh: mesh.scaled(1e-3))
    with pytest.raises(InputError, match="wrong units suspected; are mesh and translation in the same unit"):
        opened(case)
    change_mesh(case.parent, lambda mesh: mesh.scaled(1e6))
    with pytest.raises(InputError, match=r"behind .*, and give mesh and translation in the same unit"):
        opened(case)


def test_a_rounded_rotation_is_corrected_and_reported(case):
    edit(case, "[[1, 0, 0, -12]", "[[1.002, 0, 0, -12]")
    assert "rotation off by 4.0e-03, corrected to the nearest rotation" in run_here(case)


def test_a_surface_that_no_pixel_shows_is_refused_and_nothing_is_left(case):
    """Its outline surrounds the frame, so that only a render can show it."""
    sides = np.array([[-200, 0, 40], [-190, 9, 40], [-200, 9, 40], [200, 0, 40], [190, 9, 40], [200, 9, 40.0]])
    write_ply(case.parent / "surface.ply", TriangleMesh(sides, np.array([[0, 1, 2], [3, 5, 4]], np.int32)))
    with pytest.raises(InputError, match=r"^case\.toml: expected the surface in the frame, no pixel shows it; align"):
        run_here(case)
    assert not (case.parent.parent / "out").exists()


def test_a_frame_without_a_visible_pixel_is_refused_and_nothing_is_left(case):
    (case.parent / "frame.png").write_bytes(cv2.imencode(".png", np.zeros((48, 64, 4), np.uint8))[1].tobytes())
    with pytest.raises(InputError, match="no pixel shows it"):
        run_here(case)
    assert not (case.parent.parent / "out").exists()


# --- constraints and poses ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"min_observed": 1.0, "min_surface": 1.0, "distance_min": 2.0, "distance_max": 3.0},
            "of 5000 poses tried, .*showed less than 100 % of the surface that the frame shows .*; lower min_surface",
        ),
        ({"min_clearance_mm": 1e6}, r"5000 came nearer than 1e\+06 mm to the surface .*; lower min_clearance_mm"),
    ],
    ids=str,
)
def test_constraints_that_nothing_meets_end_the_run_and_leave_nothing(case, settings, message):
    (case.parent.parent / "out").mkdir()
    with pytest.raises(InputError, match=f"^view 0: found no pose that meets the constraints: .*{message}"):
        run_here(case, dataclasses.replace(OPTIONS, **settings))
    assert list((case.parent.parent / "out").iterdir()) == []


class Trap:
    """What pickle would run."""

    def __reduce__(self) -> tuple:
        return os.mkdir, ("pickle was loaded",)


def poses() -> np.ndarray:
    return np.stack([rigid(np.diag([1.0, -1, -1]), [-12, -7, 340.0])] * 3)


def one_changed(change: Callable[[np.ndarray], object]) -> np.ndarray:
    changed = poses()
    changed[1] = change(changed[1])
    return changed


POSES = {
    "wrong shape": (lambda: poses()[:, :3], r"expected shape \(N, 4, 4\) or \(4, 4\), found \(3, 3, 4\)"),
    "none": (lambda: poses()[:0], "expected poses, found an empty list"),
    "objects": (lambda: np.array([Trap(), Trap()], dtype=object), "pickled objects are never loaded"),
    "text": (lambda: np.array([["a"] * 4] * 4), "expected an array of real numbers, found type <U1"),
    "NaN": (lambda: one_changed(lambda pose: pose * np.nan), "pose 1 .counted from 0.: expected finite numbers"),
    "mirrored": (lambda: one_changed(lambda pose: pose @ np.diag([1, 1, -1, 1])), "pose 1 .*found a reflection"),
    "transposed": (lambda: one_changed(np.transpose), "pose 1 .*expected the last row 0 0 0 1"),
}


@pytest.mark.parametrize("what", POSES)
def test_bad_pose_lists_are_refused(case, tmp_path, monkeypatch, what):
    monkeypatch.chdir(tmp_path)
    array, message = POSES[what]
    np.save(tmp_path / "poses.npy", array(), allow_pickle=True)
    with pytest.raises(InputError, match=rf"^poses\.npy: .*{message}"):
        opened(case, dataclasses.replace(OPTIONS, poses=str(tmp_path / "poses.npy")))
    assert not (tmp_path / "pickle was loaded").exists()


def test_a_pickle_named_npy_is_not_loaded(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "poses.npy").write_bytes(pickle.dumps(Trap()))
    with pytest.raises(InputError, match="pickled objects are never loaded"):
        opened(case, dataclasses.replace(OPTIONS, poses=str(tmp_path / "poses.npy")))
    assert not (tmp_path / "pickle was loaded").exists()


def test_explicit_poses_that_miss_the_surface_are_rendered_and_reported(case, tmp_path):
    away = rigid(rotation_from_vector(np.array([0, 1.0, 0]))) @ read_case(case).cam_from_mesh
    np.save(tmp_path / "poses.npy", away[None])
    messages = run_here(case, dataclasses.replace(OPTIONS, poses=str(tmp_path / "poses.npy")))
    assert "no view shows any surface" in messages


# --- end to end -----------------------------------------------------------------------------------------------------


def damaged_frame(folder: Path) -> None:
    (folder / "frame.png").write_bytes((folder / "frame.png").read_bytes()[:900])


RUNS = {
    "a damaged frame": (damaged_frame, (), "the file is cut off"),
    "a mistyped option": (None, ("--conut", "3"), "command line: unknown argument '--conut'; did you mean '--count'?"),
    "an unknown engine": (
        None,
        ("--engine", "cycle"),
        "engine: expected cycles or raster or eevee, found 'cycle'",
    ),
    "a number that is none": (None, ("--count", "many"), "argument --count: invalid number value: 'many'"),
    "no views": (None, ("--count", "0"), "count: expected 1 to 1e+07, found 0"),
    "an engine of earlier versions": (None, ("--engine", "workbench"), "it is gone: write raster"),
    "an option of earlier versions": (
        None,
        ("--quality", "auto"),
        "it is gone: leave it out, and write --engine raster",
    ),
    "constraints that nothing meets": (
        None,
        ("--min-clearance-mm", "1e6", "--workers", "2", "--count", "5"),
        "found no pose that meets the constraints: of 5000 poses tried, 5000 came nearer",
    ),
}


@pytest.mark.parametrize("what", RUNS)
def test_the_script_prints_one_line_and_exits_with_2(case, tmp_path, render_command, run_command, what):
    damage, arguments, message = RUNS[what]
    if damage:
        damage(case.parent)
    ended = run_command(render_command(case, "--out", tmp_path / "deep" / "out", *arguments))
    assert_refused(ended, message)
    assert not (tmp_path / "deep").exists()


def assert_refused(ended, message: str) -> None:
    assert ended.returncode == 2, ended.stderr
    assert ended.stderr.startswith("error: ")
    assert ended.stderr.count("\n") == 1
    assert message in ended.stderr


def test_a_folder_in_place_of_a_case_is_refused(tmp_path, render_command, run_command):
    assert_refused(run_command(render_command(tmp_path, "--out", tmp_path / "out")), "a case file, cannot read it")


def test_a_rasteriser_without_opengl_is_refused(case, tmp_path, render_command, run_command):
    """Blender itself would end the process without a word, as it ends the trial: a segmentation fault in 5.2."""
    command = render_command(case, "--out", tmp_path / "out", "--engine", "eevee")
    ended = run_command(command, __EGL_VENDOR_LIBRARY_FILENAMES="/nonexistent", DISPLAY="", WAYLAND_DISPLAY="")
    assert_refused(ended, "--engine eevee: expected an OpenGL context, Blender gets none on this machine; install")
    assert "--engine cycles" in ended.stderr
    assert not (tmp_path / "out").exists()
