"""Every sample input, changed at random, ends in a value or in a sentence: no traceback, no crash, 5 s and 1 GB."""

import gzip
import json
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.images.png import encode_png
from tests.outside.victims import Victims, faults_of
from tests.volume.conftest import series_on_disk

K = np.array([[900.0, 0, 31.5], [0, 905, 23.5], [0, 0, 1]])
POSE = np.array([[1.0, 0, 0, -12], [0, -1, 0, -7], [0, 0, -1, 340], [0, 0, 0, 1]])
VIDEOS = {"film.avi": "MJPG", "film.mp4": "mp4v"}


def storage(suffix: str) -> bytes:
    file = cv2.FileStorage(f"camera{suffix}", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    file.write("image_width", 64)
    file.write("camera_matrix", K)
    file.write("distortion_coefficients", np.array([[-0.1, 0.02, 0, 0, 0.0]]))
    return file.releaseAndGetString().encode()


def frame() -> np.ndarray:
    return np.random.default_rng(3).integers(0, 256, (48, 64, 3)).astype(np.uint8)


def encoded(suffix: str, image: np.ndarray, *settings: int) -> bytes:
    return cv2.imencode(suffix, image, settings)[1].tobytes()


def films(folder: Path) -> dict[str, bytes]:
    """Videos of ten frames, as far as this OpenCV writes them."""
    made = {}
    for name, code in VIDEOS.items():
        writer = cv2.VideoWriter(str(folder / name), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*code), 25.0, (64, 48))
        if writer.isOpened():
            for _ in range(10):
                writer.write(frame())
            writer.release()
            made[name] = (folder / name).read_bytes()
    return made


def pictures() -> dict[str, bytes]:
    image = frame()
    return {
        "8.png": encode_png(image),
        "16.png": encoded(".png", image.astype(np.uint16) * 257),
        "plain.jpg": encoded(".jpg", image),
        "progressive.jpg": encoded(".jpg", image, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        "plain.tif": encoded(".tif", image, cv2.IMWRITE_TIFF_COMPRESSION, 1),
        "packed.tif": encoded(".tif", image.astype(np.uint16) * 257, cv2.IMWRITE_TIFF_COMPRESSION, 8),
        "plain.bmp": encoded(".bmp", image),
    }


def samples(case: Path) -> dict[str, tuple[str, bytes]]:
    """Name of a file -> its reader and its content."""
    vertices, faces = 3 * np.random.default_rng(4).random((30, 3)), np.arange(30).reshape(10, 3)
    obj = "".join(f"v {x} {y} {z}\n" for x, y, z in vertices) + "".join(
        f"f {a + 1}/1 {b + 1} {c + 1}\n" for a, b, c in faces
    )
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    polygons = "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    texts = {
        "camera.json": ("camera", json.dumps({"K": K.tolist(), "size": [64, 48], "distortion": [0.1, 0, 0, 0, 0]})),
        "cameras.txt": ("camera", "# COLMAP\n1 OPENCV 64 48 900 905 32 24 0.1 0 0 0\n"),
        "pose.json": ("pose", json.dumps({"cam_from_mesh": POSE.tolist()})),
        "poses.json": ("poses", json.dumps([{"cam_from_mesh": POSE.tolist()}] * 3)),
        "landmarks.csv": ("landmarks", "name,x,y,z,u,v,enabled\ntip,1,2,3,4.5,5,true\nwindow,0.1,-2,3e1,,,false\n"),
        "landmarks.json": ("landmarks", json.dumps([{"name": "tip", "surface": [1.5, 2, 3], "pixel": [4, 5]}] * 1)),
        "photographs.json": ("photographs", json.dumps([{"image": "a.png", "cam_from_mesh": POSE.tolist()}])),
        "mesh.obj": ("mesh", obj),
        "mesh.stl": ("mesh", f"solid a\n{facet * 3}endsolid a\n"),
        "text.ply": ("mesh", f"{header}{polygons}0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 2\n4 0 1 3 2\n"),
    }
    points, corners = vertices.astype("<f4"), faces.astype("<i4")
    binary_header = header.replace("ascii", "binary_little_endian").replace("vertex 4", "vertex 30")
    binary = points.tobytes() + b"".join(b"\x03" + row.tobytes() for row in corners)
    binary_stl = b"".join(bytes(12) + points[row].tobytes() + bytes(2) for row in corners)
    arrays = {"camera.npy": ("camera", K), "pose.npy": ("pose", POSE), "poses.npy": ("poses", np.stack([POSE] * 3))}
    made = {name: (reader, text.encode()) for name, (reader, text) in texts.items()}
    for name, (reader, array) in arrays.items():
        np.save(case.parent / name, array)
        made[name] = reader, (case.parent / name).read_bytes()
    np.savez_compressed(case.parent / "camera.npz", mtx=K, dist=np.zeros(5))
    return made | {
        "case.toml": ("case", case.read_bytes()),
        "camera.yml": ("camera", storage(".yml")),
        "camera.npz": ("camera", (case.parent / "camera.npz").read_bytes()),
        "camera.pkl": ("camera", pickle.dumps({"camera_intrinsics": K, "canvas_height": 48, "canvas_width": 64})),
        "binary.ply": ("mesh", (binary_header + polygons.replace("face 2", "face 10")).encode() + binary),
        "binary.stl": ("mesh", bytes(80) + (10).to_bytes(4, "little") + binary_stl),
        **{name: ("image header", data) for name, data in pictures().items()},
        **{name: ("video", data) for name, data in films(case.parent).items()},
    }


def volumes(folder: Path) -> dict[str, tuple[str, bytes]]:
    """CT and labels in every format, a slice of a series, and a plan of a drill."""
    nibabel, sitk = pytest.importorskip("nibabel"), pytest.importorskip("SimpleITK")
    rng = np.random.default_rng(5)
    values = rng.integers(-1000, 2000, (6, 7, 8)).astype(np.int16)
    image = nibabel.Nifti1Image(values, np.diag([-0.4, -0.4, 0.8, 1]))
    made = {"ct.nii": ("volume", image.to_bytes()), "ct.nii.gz": ("volume", gzip.compress(image.to_bytes()))}
    made["labels.nii"] = "labels", nibabel.Nifti1Image((values % 3).astype(np.uint8), np.eye(4)).to_bytes()
    for name, packed in (("ct.nrrd", False), ("packed.nrrd", True), ("ct.mha", False), ("packed.mha", True)):
        sitk.WriteImage(sitk.GetImageFromArray(values), folder / name, packed)
        made[name] = "volume", (folder / name).read_bytes()
    series_on_disk(folder / "series", 3)
    first = min((folder / "series").iterdir())
    made[first.name] = "slice", first.read_bytes()
    plan = "[margins_mm]\nfacial_nerve = 1.0\n[[strokes]]\nradius_mm = 2.0\npoints_mm = [[1, 2, 3], [4.5, 5, -6e1]]\n"
    return made | {"plan.toml": ("drill plan", plan.encode())}


SPECIAL = (0, 1, 127, 128, 255, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Bits flipped, bytes and numbers replaced, parts cut off, moved, repeated; near the beginning as often as not."""
    changed = bytearray(data)
    for _ in range(rng.choice([1, 1, 2, 4, 16])):
        size = len(changed)
        if size < 8:
            break
        at = int(rng.integers(min(size, 400) if rng.random() < 0.5 else size))
        length = int(rng.integers(1, 64))
        match rng.integers(8):
            case 0:
                changed[at] ^= 1 << int(rng.integers(8))
            case 1:
                changed[at] = int(rng.choice([0, 9, 10, 34, 45, 46, 57, 91, 93, 123, 255]))
            case 2:
                order = "little" if rng.random() < 0.5 else "big"
                changed[at : at + 4] = int(rng.choice(SPECIAL)).to_bytes(4, order)
            case 3:
                del changed[at:]
            case 4:
                del changed[at : at + length]
            case 5:
                other = int(rng.integers(size))
                changed[at:at] = changed[other : other + length]
            case 6:
                changed[at:at] = changed[at : at + length] * int(rng.choice([2, 50, 1000]))
            case 7:
                changed[at:at] = rng.bytes(length)
    return bytes(changed)


def faults(made: dict[str, tuple[str, bytes]], times: int, folder: Path, seed: int) -> list[str]:
    """What is wrong with the answers to a number of mutations of each file."""
    answers = []
    with Victims() as victims:
        for number, (name, (reader, data)) in enumerate(made.items()):
            # a film, whose decoder is a process, takes a hundred times as long
            apart = reader == "video"
            rng, place = np.random.default_rng([seed, number]), folder / name
            place.mkdir()
            if reader == "slice":
                # beside the others of its series
                shutil.copytree(folder / "samples" / "series", place, dirs_exist_ok=True)
            for turn in range(times // 10 if apart and times > 10 else times):
                (place / name).write_bytes(mutated(data, rng))
                answer = victims.opened(reader, place / name)
                answers.append((f"{name}, turn {turn}, seed {seed}", name, answer))
    return faults_of(answers)


@pytest.fixture
def sample_files(tmp_path, write_tiny_case: Callable[[Path], Path]) -> dict[str, tuple[str, bytes]]:
    return samples(write_tiny_case(tmp_path / "samples"))


def test_mutations_end_in_a_value_or_a_sentence(tmp_path, long_form, sample_files):
    assert faults(sample_files, 500 if long_form else 6, tmp_path, seed=8) == []


def test_mutations_of_volumes_end_in_a_value_or_a_sentence(tmp_path, long_form):
    (tmp_path / "samples").mkdir()
    assert faults(volumes(tmp_path / "samples"), 300 if long_form else 2, tmp_path, seed=10) == []


@pytest.mark.render
def test_mutated_images_end_in_a_value_or_a_sentence_in_blender(tmp_path, long_form):
    made = {name: ("image", data) for name, data in pictures().items()}
    assert faults(made, 500 if long_form else 6, tmp_path, seed=9) == []
