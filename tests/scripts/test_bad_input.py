"""Every kind of wrong input: refused with one message that says where and what to do; no files are left behind."""

import dataclasses
import io
import json
import zlib
from pathlib import Path

import numpy as np
import pytest

from oneframe.blender.dataset import run as dataset_run
from oneframe.blender.dataset.job import Job, open_job
from oneframe.blender.render.engines import RENDERERS
from oneframe.case.case_file import read_case
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.run_folder import Shard
from oneframe.errors import InputError
from oneframe.evaluation.evaluate import evaluation_run
from oneframe.evaluation.methods import DEFAULT, chosen_methods
from oneframe.images.png import encode_png
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import rigid, rotation_from_vector

pytestmark = pytest.mark.render

OPTIONS = DatasetOptions(count=2)


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


# --- the frame ------------------------------------------------------------------------------------------------------


def claiming(png: bytes, side_px: int) -> bytes:
    """The PNG with another size in its header, whose checksum is right."""
    header = b"IHDR" + side_px.to_bytes(4, "big") * 2 + png[24:29]
    return png[:12] + header + zlib.crc32(header).to_bytes(4, "big") + png[33:]


FRAMES = {
    "PNG cut off": (lambda png: png[:-200], "the file is cut off; copy it again"),
    "PNG that takes gigabytes": (
        lambda png: claiming(png, 20_000),
        r"expected an image of at most 25\.0 million pixels, found 20000x20000; crop it or scale it down",
    ),
    "another kind of file": (lambda _: b"solid mesh", "expected an image"),
}


@pytest.mark.parametrize("what", FRAMES)
def test_bad_frames_are_refused(case, what):
    damage, message = FRAMES[what]
    path = case.parent / "frame.png"
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(InputError, match=rf"^case\.toml: image frame\.png: .*{message}"):
        opened(case)


def test_a_frame_of_another_size_than_the_cameras_is_refused(case):
    (case.parent / "frame.png").write_bytes(encode_png(np.zeros((96, 128, 3), np.uint8)))
    message = r"expected a frame of 64x48 px as its camera has, frame\.png has 128x96; .*give the K of this image"
    with pytest.raises(InputError, match=message):
        opened(case)


@pytest.mark.parametrize("image", ["gone.png", "a\0b.png", "\ud800.png"])
def test_a_photograph_that_cannot_be_read_is_named_before_any_work(case, image):
    listed = case.parent / "photographs.json"
    listed.write_text(json.dumps([{"image": image, "cam_from_mesh": read_case(case).cam_from_mesh.tolist()}]))
    with pytest.raises(InputError, match="expected a photograph"):
        evaluation_run([(case, listed)], case.parent.parent / "out", chosen_methods(DEFAULT, RENDERERS))


# --- frame, surface and pose together -------------------------------------------------------------------------------

MISFITS = {
    "a path of Windows": (('"frame.png"', r'".\frame.png"'), r"does not exist; write / in paths, not \\$"),
    "behind": (("-1, 340]", "-1, -340]"), "surface in front of the camera, all of it is behind .*mesh_from_cam"),
    "beside": (
        ("-12]", "150]"),
        r"expected the surface in the frame, it lies (left|right) of the frame.*: u .* of 64x48; align the pose",
    ),
    "a thousand times too far": (("340]", "300000]"), "working distance of 2 mm to 30 m, .*: wrong units suspected"),
    "in metres, said to be millimetres": (
        ('units = "mm"', 'units = "m"'),
        "the surface is .*e.05 mm away: wrong units",
    ),
}


@pytest.mark.parametrize("what", MISFITS)
def test_what_does_not_fit_together_is_refused(case, what):
    edits, message = MISFITS[what]
    edit(case, *edits)
    with pytest.raises(InputError, match=rf"^case\.toml: .*{message}"):
        opened(case)


def test_a_surface_that_no_pixel_shows_is_refused_and_nothing_is_left(case):
    """Its outline surrounds the frame, so that only a render can show it."""
    sides = np.array([[-200, 0, 40], [-190, 9, 40], [-200, 9, 40], [200, 0, 40], [190, 9, 40], [200, 9, 40.0]])
    write_ply(case.parent / "surface.ply", TriangleMesh(sides, np.array([[0, 1, 2], [3, 5, 4]], np.int32)))
    with pytest.raises(InputError, match=r"^case\.toml: expected the surface in the frame, no pixel shows it; align"):
        run_here(case)
    assert not (case.parent.parent / "out").exists()


def test_explicit_poses_that_miss_the_surface_are_rendered_and_reported(case, tmp_path):
    away = rigid(rotation_from_vector(np.array([0, 1.0, 0]))) @ read_case(case).cam_from_mesh
    np.save(tmp_path / "poses.npy", away[None])
    messages = run_here(case, dataclasses.replace(OPTIONS, poses=str(tmp_path / "poses.npy")))
    assert "no view shows any surface" in messages
    assert "poses: the first 1 show no surface; cam_from_mesh maps the mesh to OpenCV axes" in messages
    np.save(tmp_path / "poses.npy", (np.diag([1.0, -1, -1, 1]) @ read_case(case).cam_from_mesh)[None])
    with pytest.raises(
        InputError, match=r"^poses.npy: pose 0 .*: expected the surface in front of the camera, .*negate"
    ):
        run_here(case, dataclasses.replace(OPTIONS, poses=str(tmp_path / "poses.npy")))
    metres = read_case(case).cam_from_mesh
    metres[:3, 3] /= 1000
    np.save(tmp_path / "poses.npy", metres[None])
    with pytest.raises(InputError, match=r"^poses.npy: pose 0 .*: expected (a working distance|the surface in front)"):
        run_here(case, dataclasses.replace(OPTIONS, poses=str(tmp_path / "poses.npy")))


def test_a_rasteriser_without_opengl_is_refused(case, tmp_path, render_command, run_command):
    """Blender itself would end the process without a word, as it ends the trial: a segmentation fault in 5.2."""
    command = render_command(case, "--out", tmp_path / "out", "--engine", "eevee")
    ended = run_command(command, __EGL_VENDOR_LIBRARY_FILENAMES="/nonexistent", DISPLAY="", WAYLAND_DISPLAY="")
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert "error: --engine eevee: expected an OpenGL context, Blender gets none on this machine" in ended.stderr
    assert not (tmp_path / "out").exists()
