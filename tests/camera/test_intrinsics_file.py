"""Camera and pose files: every format gives the same camera, and what is no such file is refused."""

import io
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.camera.intrinsics_file import CameraFile, read_camera
from oneframe.camera.pinhole import PinholeCamera
from oneframe.camera.plausibility import fit_of
from oneframe.errors import InputError
from oneframe.poses.pose_file import read_pose
from oneframe.transforms import rigid, rotation_from_vector

SIZE = (1920, 1080)
DISTORTION = (-0.31, 0.12, 0.001, -0.0005, 0.02)


def k_of(fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


K = k_of(5204.6, 5217.9, 961.3, 551.7)


def case_toml(k):
    rows = ", ".join(str(row) for row in k.tolist())
    return f'[camera]\nsize = [1920, 1080]\nK = [{rows}]\npixel_origin = "center"\ndistortion = {list(DISTORTION)}\n'


def as_json(**table):
    return json.dumps(table)


def opencv(k, suffix):
    file = cv2.FileStorage(f"camera{suffix}", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    file.write("image_width", 1920)
    file.write("image_height", 1080)
    file.write("camera_matrix", k)
    file.write("distortion_coefficients", np.array([DISTORTION]))
    return file.releaseAndGetString()


def ros(k):
    return (
        "# calibrated\nimage_width: 1920\nimage_height: 1080\ncamera_name: microscope/left\n"
        f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: {k.ravel().tolist()}\n"
        f"distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: {list(DISTORTION)}\n"
        "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"
    )


def parts(k):
    return {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]}


def colmap(k, name, values):
    shifted = " ".join(map(repr, (k[:2, 2] + 0.5).tolist()))
    return f"# Camera list\n1 {name} 1920 1080 {values} {shifted}"


def saved(save, value):
    buffer = io.BytesIO()
    save(buffer, value)
    return buffer.getvalue()


def named(names, values=DISTORTION):
    return dict(zip(names.split(), values, strict=True))


ALL = {
    "pyyaml": lambda k: yaml.dump(
        {"camera_matrix": k.tolist(), "dist_coeff": [list(DISTORTION)], "image_size": list(SIZE)}
    ),
    "ros without commas": lambda k: ros(k).replace(", ", " "),
    "camodocal": lambda k: yaml.dump(
        {
            "model_type": "PINHOLE", "image_width": 1920, "image_height": 1080,
            "distortion_parameters": named("k1 k2 p1 p2 k3"),
            "projection_parameters": {name: float(value) for name, value in parts(k).items()},
        }
    ),
    "case": case_toml,
    "json K": lambda k: as_json(K=k.tolist(), width=1920, height=1080, D=[list(DISTORTION)]),
    "json camera_matrix": lambda k: as_json(
        camera_matrix={"rows": 3, "cols": 3, "dt": "d", "data": k.ravel().tolist()},
        image_width=1920, image_height=1080, distortion_coefficients={"data": list(DISTORTION)},
    ),
    "json parts": lambda k: as_json(
        intrinsics=parts(k), resolution=[1920, 1080], distortion=list(DISTORTION), name="left"
    ),
    "json coefficients": lambda k: as_json(
        camera={**parts(k), "size": [1920, 1080], **dict(zip(("k1", "k2", "p1", "p2", "k3"), DISTORTION, strict=True))}
    ),
    "opencv yaml": lambda k: opencv(k, ".yml"),
    "ros yaml": ros,
    "ros yaml of a whole sensor": lambda k: ros(k) + "binning_x: 1\nbinning_y: 0\n"
    "roi: {x_offset: 0, y_offset: 0, width: 1920, height: 1080, do_rectify: false}\n",
    "ros yaml as it is printed": lambda k: f"---\n{ros(k)}\n---\n",
}  # fmt: skip
WITH_SIZE = {
    "kalibr": lambda k: yaml.dump(
        {"cam0": {"camera_model": "pinhole", "intrinsics": [*map(float, parts(k).values())], "resolution": list(SIZE)}}
    ),
    "bop camera.json": lambda k: as_json(**parts(k), depth_scale=0.1, width=1920, height=1080),
    "colmap": lambda k: colmap(k, "PINHOLE", f"{k[0, 0]:.17g} {k[1, 1]:.17g}"),
}
WITHOUT_SIZE = {
    "bop scene_camera.json": lambda k: as_json(
        **{str(image): {"cam_K": k.ravel().tolist(), "depth_scale": 1.0} for image in range(3)}
    ),
}


def file_of(folder: Path, content: bytes | str, name: str = "camera") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def read(folder: Path, content: bytes | str) -> CameraFile:
    return read_camera(file_of(folder, content))


def found(file: CameraFile) -> list[float]:
    return [file.fx, file.fy, file.cx, file.cy]


ks = st.builds(
    k_of, fx=st.floats(1, 1e5), fy=st.floats(1, 1e5), cx=st.floats(-1000, 3000), cy=st.floats(-1000, 3000)
).filter(lambda k: k[0, 2] != 0 and k[1, 2] != 0)


@pytest.mark.parametrize("name", [*ALL, *WITH_SIZE, *WITHOUT_SIZE])
@settings(max_examples=4)
@given(k=ks)
def test_every_format_gives_the_same_camera(tmp_path_factory, name, k):
    write = (ALL | WITH_SIZE | WITHOUT_SIZE)[name]
    file = read(tmp_path_factory.getbasetemp(), write(k))
    # COLMAP's half pixel is added and subtracted again
    np.testing.assert_allclose(found(file), [k[0, 0], k[1, 1], k[0, 2], k[1, 2]], rtol=1e-15, atol=1e-12)
    assert file.size == (None if name in WITHOUT_SIZE else SIZE)
    assert file.distortion == (DISTORTION if name in ALL else None)
    assert file.camera(SIZE).size_wh == SIZE


def test_colmap_and_nerf_count_from_the_corner(tmp_path):
    file = read(tmp_path, "3 SIMPLE_RADIAL 640 480 500 320 240 0.01\n")
    assert found(file) == [500, 500, 319.5, 239.5]
    assert file.distortion == (0.01, 0, 0, 0, 0)
    nerf = as_json(fl_x=500.0, fl_y=510.0, cx=320.0, cy=240.0, w=640, h=480, frames=[])
    assert found(read(tmp_path, nerf)) == [500, 510, 319.5, 239.5]
    corner = case_toml(K).replace('"center"', '"corner"')
    assert found(read(tmp_path, corner))[2:] == [960.8, 551.2]


def test_distortion_is_checked_for_its_camera(tmp_path):
    file = read(tmp_path, ALL["ros yaml"](K))
    assert file.distortion_for(file.camera(SIZE)).p2 == DISTORTION[3]
    for coefficients in ([-1000.0, 0.0, 0.0, 0.0], [1e6, 0.0, 0.0, 0.0]):
        folded = read(tmp_path, as_json(K=K.tolist(), dist=coefficients))
        with pytest.raises(InputError, match="folds most of it over, or moves it by more than its size"):
            folded.distortion_for(folded.camera(SIZE))


BAD = {
    "two cameras": (
        as_json(left={"K": K.tolist()}, right={"K": (2 * K - K * [[0], [0], [1]]).tolist()}),
        "expected one camera, found 2 that differ: 'left', 'right'",
    ),
    "two that contradict": (as_json(K=K.tolist(), fx=1.0, fy=1.0, cx=1.0, cy=1.0), "2 that differ: 'k', 'fx'"),
    "no number": (as_json(fx=np.nan, fy=1.0, cx=1.0, cy=1.0), "expected finite numbers"),
    "no camera": (as_json(R=np.eye(3).tolist(), note="Doe"), "found R, note; write K in pixels"),
    "ORB-SLAM's": (
        'Camera.type: "PinHole"\nCamera1.fx: 458.6\nCamera1.cx: 367.2\n',
        "found Camera1.fx, Camera1.cx; write",
    ),
    "OpenSfM's": (
        as_json(cam={"projection_type": "brown", "width": 640, "focal": 0.9}),
        "found projection_type, focal; ",
    ),
    "Metashape's": ("<calibration><f>1500</f><cx>3</cx></calibration>", "found another kind of file"),
    "MATLAB's transposed": (as_json(IntrinsicMatrix=K.T.tolist()), r"expected \[\[fx, 0, cx\]"),
    **{
        f"a part of the sensor: {name}": (
            ros(K).replace("camera_name", f"{part}\ncamera_name"),
            f"found {name}: the image is a part",
        )
        for name, part in {
            "roi": "roi: {x_offset: 160, y_offset: 0, width: 320, height: 240, do_rectify: false}",
            "binning_x": "binning_x: 2",
            "OffsetX": "OffsetX: 16",
            "crop": "crop: [8, 8, 640, 480]",
        }.items()
    },
    "MATLAB's": (as_json(IntrinsicMatrix=K.T.tolist(), RadialDistortion=[0.1, 0]), "found RadialDistortion"),
    "an array of NumPy": (saved(np.save, K), "found another kind of file; write its numbers as JSON"),
    "a pickle": (b"\x80\x04\x95\x00", "found another kind of file"),
    "the model in a table of distortion": (
        as_json(K=K.tolist(), distortion={"type": "equidistant", "k1": 0.1}),
        "found distortion = ",
    ),
    "eight coefficients": (as_json(K=K.tolist(), D=[0.1] * 8), r"found D = \[0.1, .*; undistort"),
    "fisheye": (
        as_json(K=K.tolist(), D=[0.1] * 4, distortion_model="equidistant"),
        "expected OpenCV's distortion .* found distortion_model = 'equidistant'; undistort",
    ),
    "a key twice in JSON": ('{"fx": 9, "cx": 9, "cy": 9, "cx": 8}', "the key 'cx' twice"),
    "a key twice in YAML": ("fx: 9\ncx: 9\ncy: 9\ncx: 8\n", "it holds 'cx' twice"),
    "OpenCV's XML": (opencv(K, ".xml"), "found another kind of file; write its numbers as JSON"),
    "YAML that grows": (
        "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}' if i else '1'] * 9)}]\n" for i in range(30)),
        r"it names a list again, as \*id001: write each list out",
    ),
    "COLMAP's fisheye": ("1 OPENCV_FISHEYE 640 480 500 500 320 240 0 0 0 0", "found OPENCV_FISHEYE; undistort"),
    "broken YAML": ("%YAML:1.0\n---\nK: [1, 2\n", "expected YAML, cannot read it"),
    "nothing": (b"", "found an empty file"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_camera_is_refused(tmp_path, name):
    content, message = BAD[name]
    with pytest.raises(InputError, match=f"^camera: .*{message}"):
        read(tmp_path, content)


def message_of(folder: Path, content: bytes) -> str:
    """The message about a camera file; any exception other than InputError is a defect."""
    try:
        read(folder, content)
    except InputError as error:
        return str(error)
    return "camera: taken"


@pytest.mark.parametrize("name", ["opencv yaml", "json K", "case", "colmap"])
@given(data=st.data())
def test_damaged_files_give_a_camera_or_a_message(tmp_path_factory, name, data):
    content = (ALL | WITH_SIZE | WITHOUT_SIZE)[name](K)
    content = bytearray(content.encode() if isinstance(content, str) else content)
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    content = content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content
    assert message_of(tmp_path_factory.getbasetemp(), bytes(content)).startswith("camera: ")


# --- whether it fits


def camera_file(k: np.ndarray = K, size: tuple[int, int] | None = SIZE) -> CameraFile:
    return CameraFile(Path("camera.json"), k[0, 0], k[1, 1], k[0, 2], k[1, 2], size, None)


@pytest.mark.parametrize("size", [(3840, 2160), (1000, 563), (240, 135)])
def test_a_resized_image_gets_a_rescaled_camera(size):
    fit = fit_of(camera_file(), size)
    assert fit.rescaled == PinholeCamera(*SIZE, *found(camera_file())).resized(*size)
    (message,) = fit.messages
    assert (
        f"K is for images of 1920x1080 px, this image has {size[0]}x{size[1]}: if one is the other resized" in message
    )


@pytest.mark.parametrize(
    ("file", "size", "message"),
    [
        (camera_file(), (1440, 1080), "another aspect ratio: it was cropped"),
        (camera_file(), (1080, 1920), "rotated by 90°, or width and height are swapped"),
        (camera_file(size=None), (960, 540), r"lies \(\+482, \+282\) px off the centre .* an image of 1924x1104 px"),
        (camera_file(k_of(35.0, 35.0, 959.5, 539.5)), SIZE, "a field of view of 176°, .* in millimetres"),
        (camera_file(k_of(1e6, 1e6, 959.5, 539.5)), SIZE, "a field of view of 0.11°"),
        (camera_file(k_of(5000.0, 5600.0, 959.5, 539.5)), SIZE, "fx = 5000 and fy = 5600 differ by 11%"),
        (camera_file(k_of(2.7, 4.8, 0.5, 0.5), None), SIZE, "multiply a part of the image's size by that size"),
    ],
)
def test_what_does_not_fit_gives_a_message(file, size, message):
    fit = fit_of(file, size)
    assert any(re.search(message, each) for each in fit.messages), fit.messages
    assert fit.rescaled is None


def test_pixels_that_are_not_square_are_those_of_the_film():
    """240x240 px that players show as 320x240."""
    k, stored = k_of(1125.0, 1500.0, 119.5, 119.5), (240, 240)
    assert fit_of(camera_file(k, stored), stored, 4 / 3).messages == ()
    assert (
        "fx should be 0.75 of fy"
        in fit_of(camera_file(k_of(1500, 1500, 119.5, 119.5), stored), stored, 4 / 3).messages[0]
    )
    assert "which only pixels that are not square explain" in fit_of(camera_file(k, stored), stored).messages[0]
    as_shown = fit_of(camera_file(k_of(1500.0, 1500.0, 159.5, 119.5), (320, 240)), stored, 4 / 3)
    np.testing.assert_allclose(as_shown.rescaled.k, k)
    assert "players show as 320x240" in as_shown.messages[0]


# --- poses


POSE = rigid(rotation_from_vector(np.array([0.3, -2.0, 0.4])), np.array([1.25, -3.5, 300.0]))
POSES = {
    "npy": saved(np.save, POSE),
    "flat npy": saved(np.save, POSE.ravel()),
    "text": "\n".join(" ".join(map(repr, row)) for row in POSE.tolist()),
    "json": json.dumps(POSE.tolist()),
    "json entry": as_json(name="frame 3", cam_from_mesh=POSE.tolist(), K=K.tolist()),
}


@pytest.mark.parametrize("name", POSES)
def test_poses_are_read_to_the_last_bit(tmp_path, name):
    pose, messages = read_pose(file_of(tmp_path, POSES[name]))
    assert np.array_equal(pose, POSE)
    assert messages is None
    metres, _ = read_pose(file_of(tmp_path, POSES[name]), mm_per_unit=1000.0)
    assert metres[:3, 3].tolist() == [1250, -3500, 300_000]


@pytest.mark.parametrize("name", ["transform_matrix", "c2w", "world_from_cam", "pose"])
def test_a_pose_under_a_name_that_is_not_ours_is_refused(tmp_path, name):
    with pytest.raises(InputError, match=f"expected the key cam_from_mesh, found '{name}'; write cam_from_mesh"):
        read_pose(file_of(tmp_path, as_json(**{name: POSE.tolist()})))


def test_one_of_several_cameras_is_named_by_its_key(tmp_path):
    path = tmp_path / "scene_camera.json"
    cameras = {str(number): {"cam_K": (K * [[number], [number], [1]]).ravel().tolist()} for number in (1, 2)}
    path.write_text(json.dumps(cameras))
    assert read_camera(Path(f"{path}#2")).fx == pytest.approx(2 * K[0, 0])
    with pytest.raises(InputError, match=r"scene_camera.json: expected a camera '9' in it, found none"):
        read_camera(Path(f"{path}#9"))
