"""The command as a user starts it: the picture and what is said about it; what cannot be drawn is refused."""

import json
import re
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.case.case_file import read_case
from oneframe.commands.__main__ import dispatch
from oneframe.errors import InputError
from oneframe.images.png import encode_png
from oneframe.sample.distance_field import tube
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import transform_points

pytestmark = pytest.mark.render

WIDTH, HEIGHT = 320, 240
STRUCTURES = """
[[structures]]
name = "facial_nerve"
mesh = "nerve.ply"
[[structures]]
name = "chorda_tympani"
mesh = "chorda.ply"
"""


@pytest.fixture
def overlay(run_oneframe):
    return partial(run_oneframe, "overlay")


@pytest.fixture
def case_path(tmp_path, write_tiny_case) -> Path:
    """The tiny case five times as large, a nerve below and above its hills, and a chorda that is out of view."""
    path = write_tiny_case(tmp_path / "case")
    text = path.read_text().replace("[64, 48]", f"[{WIDTH}, {HEIGHT}]")
    text = text.replace("[[320.0, 0, 30.0], [0, 318.0, 25.5]", "[[1600.0, 0, 152.0], [0, 1590.0, 129.5]")
    path.write_text(text + STRUCTURES)
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    image = np.stack([140 + 40 * np.sin(u / 9), 110 + 40 * np.cos(v / 7), 90 + 0 * u, 255 * (u < 200)], -1)
    (path.parent / "frame.png").write_bytes(encode_png(image.astype(np.uint8)))
    offset = np.array([12.0, -7.0, 40.0])
    nerve = tube(np.array([[-20.0, -6, -6], [-5, 8, 5], [8, -4, 5], [22, 6, -6]]) + offset, 1.5)
    write_ply(path.parent / "nerve.ply", nerve)
    chorda = tube(np.array([[-1.0, 0, 0], [0, 2, 1], [2, 3, 1]]) + offset + [-300.0, 0, 0], 0.5)
    write_ply(path.parent / "chorda.ply", chorda)
    return path


def picture(path: Path) -> np.ndarray:
    return cv2.imread(str(path))[..., ::-1]


def refused(ended, message: str) -> None:
    assert ended.returncode == 2
    assert ended.stderr.startswith("error: ")
    assert ended.stderr.count("\n") == 1
    assert re.search(message, ended.stderr), ended.stderr


def test_the_picture_and_what_it_says(overlay, case_path, tmp_path):
    out = tmp_path / "out" / "overlay.png"
    ended = overlay(case_path, "--out", out)
    assert (ended.returncode, ended.stderr) == (0, "")
    lines = ended.stdout.splitlines()
    assert re.fullmatch(r"facial_nerve: \d+ % visible, to \d\.\d mm deep", lines[0])
    assert lines[1] == "chorda_tympani: left of the frame"
    assert re.fullmatch(r"scale bar: 5 mm at the structures, \d{3} mm away", lines[2])
    assert lines[3] == f"overlay: {out}"
    first = out.read_bytes()
    assert overlay(case_path, "--out", out).returncode == 0
    assert out.read_bytes() == first

    drawn, frame = picture(out), picture(case_path.parent / "frame.png")
    assert drawn.shape == frame.shape
    # the nerve is there, in its colour, where the case projects it
    case = read_case(case_path)
    middle = case.camera.project(transform_points(case.cam_from_mesh, np.array([[13.5, -5.0, 46.0]])))[0]
    red, green, blue = drawn[round(middle[1]), round(middle[0])]
    assert min(red, blue) > 2 * green

    plain, under = tmp_path / "plain.png", tmp_path / "under.png"
    assert overlay(case_path, "--out", plain, "--plain").returncode == 0
    assert overlay(case_path, "--out", under, "--plain", "--under-instruments").returncode == 0
    hidden = np.arange(WIDTH) >= 200
    np.testing.assert_array_equal(picture(under)[:, hidden], frame[:, hidden])
    np.testing.assert_array_equal(picture(under)[:, ~hidden], picture(plain)[:, ~hidden])
    assert (picture(plain)[:, hidden] != frame[:, hidden]).any()
    # legend and scale bar explain in the corners
    assert (picture(plain) != drawn).any(axis=-1).mean() > 0.02


def test_what_cannot_be_drawn_is_refused(overlay, case_path, tmp_path):
    out, film, poses = tmp_path / "o.png", tmp_path / "film.avi", tmp_path / "poses.json"
    writer = cv2.VideoWriter(str(film), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*"FFV1"), 25, (WIDTH, HEIGHT))
    for _ in range(3):
        writer.write(np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    writer.release()
    poses.write_text(json.dumps([np.eye(4).tolist()] * 2))
    video = ("--video", film, "--poses", poses)
    for options, message in (
        (video[:2], "--video: expected --poses with it"),
        (video[2:], "--poses: expected --video with it"),
        ((*video, "--under-instruments"), "expected no --video, whose frames have no alpha"),
    ):
        with pytest.raises(InputError, match=message):
            dispatch(["overlay", *map(str, (case_path, "--out", out, *options))])
    refused(
        overlay(case_path, *video, "--out", tmp_path / "o.mp4"),
        r"poses.json: expected a pose for each of the 3 frames of the video, found 2; write null",
    )
    text = case_path.read_text()
    case_path.write_text(text.replace("[1, 0, 0, -12]", "[1, 0, 0, -312]"))
    refused(overlay(case_path, "--out", out), "expected the surface in the frame, it lies left of the frame: u -")
    assert {path.name for path in tmp_path.iterdir()} == {"case", "film.avi", "poses.json"}


def test_white_structures_are_context_and_others_can_be_chosen(overlay, case_path, tmp_path):
    (case_path.parent / "dura.ply").write_bytes((case_path.parent / "nerve.ply").read_bytes())
    case_path.write_text(case_path.read_text() + '[[structures]]\nname = "dura"\nmesh = "dura.ply"\n')
    lines = {}
    for number, only in enumerate(((), ("dura",), ("dura", "facial_nerve"))):
        options = [word for name in only for word in ("--only", name)]
        lines[number] = overlay(case_path, "--out", tmp_path / f"{number}.png", "--plain", *options).stdout
    assert "not drawn: dura; " in lines[0]
    assert "not drawn: facial_nerve, chorda_tympani; " in lines[1]
    assert "not drawn: chorda_tympani; " in lines[2]
    magenta, white = (picture(tmp_path / f"{number}.png").astype(int) for number in (0, 1))
    differs = (magenta != white).any(axis=-1)
    assert differs.sum() > 100
    assert ((white - magenta)[differs][:, 1] >= 0).all()
    with pytest.raises(InputError, match="no structure is named 'nerve'"):
        dispatch(["overlay", str(case_path), "--out", str(tmp_path / "x.png"), "--only", "nerve"])
