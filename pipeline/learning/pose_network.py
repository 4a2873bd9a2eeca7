"""A trained network, run by OpenCV: which point of the surface an image shows where, and the pose that follows from it.

Scene coordinates (Shotton et al., CVPR 2013), and a pose of them by RANSAC and a robust fit.
"""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

import cv2
import numpy as np
from scipy.optimize import least_squares

from ..camera.pinhole import PinholeCamera
from ..case.loaded_case import LoadedCase
from ..dataset.identity import geometry_hash
from ..errors import InputError
from ..files.content import read_content
from ..images.pixel_values import to_uint8
from ..transforms import rigid, rotation_from_vector

STRIDE = 8
"""Pixels from one cell of the network to the next."""
MULTIPLE = 2 * STRIDE
"""Width and height of what the network sees are multiples of this."""
TURNS_DEG = (-12, -4, 4, 12)
"""Of the copies of a photograph: their errors partly cancel."""
LEAST_LOGIT = 1.0
"""That a cell shows the surface."""
FEWEST, SUREST = 12, 0.7
"""Points without which there is no pose, and the part of them that is used."""
OUTLIER = 3.0
"""Times the median of the stated errors."""
NEAREST_MM = 1.0
LARGEST_ZOOM = 1.5
"""Of a case's K beside that of the views."""
DARKEST, BRIGHTEST = 0.02, 0.98
"""Quantiles of code values between which an image is stretched as the case's frame."""
FARTHEST = 20.0
"""Largest coordinate of a cell, in half longest sides of the surface, and logarithm of its error."""
KEY, UNSEALED = "oneframe", b"#" * 64
"""Of the record in the file's metadata; and what stands in it for the SHA-256 of the file, until :func:`sealed`."""


@dataclass(frozen=True)
class NetworkRecord:
    """What a network belongs to, in the metadata of its file.

    Attributes
    ----------
    surface, dataset
        ``geometry_sha256`` of the surface, and identity of the dataset that it was trained on.
    views, steps, seed
        Of the training.
    width, height, fx
        Of what it saw, px.
    centre_model, reach_mm
        Coordinates are from the middle of the surface's box, in units of half of its longest side.
    """

    surface: str
    dataset: str
    views: int
    steps: int
    seed: int
    width: int
    height: int
    fx: float
    centre_model: tuple[float, float, float]
    reach_mm: float

    def text(self) -> str:
        """JSON, in ASCII, of a file that is not sealed yet."""
        return json.dumps(asdict(self) | {"sha256": UNSEALED.decode()})

    @classmethod
    def of_file(cls, data: bytes, name: str) -> Self:
        """The record in the content of an ONNX file."""
        # an entry of the metadata: field 1 the key, field 2 the value and its length, of which no byte is a brace
        _, marked, after = data.rpartition(b"\x0a" + bytes([len(KEY)]) + KEY.encode() + b"\x12")
        try:
            values = json.JSONDecoder().raw_decode(after[after.index(b"{") :].decode("latin-1"))[0] if marked else {}
            # OpenCV crashes on some that are damaged, and nobody but train writes the record
            is_whole = sealed(data.replace(str(values.pop("sha256")).zfill(64).encode(), UNSEALED)) == data
            record = cls(**(values | {"centre_model": tuple(values["centre_model"])}))
        except (KeyError, TypeError, ValueError, RecursionError):
            is_whole = False
        if not is_whole:
            raise InputError(
                f"{name}: expected a whole network that oneframe train wrote, found another file, or a damaged one; "
                "name its file, or copy it again"
            )
        return record


def sealed(data: bytes) -> bytes:
    """The content of an ONNX file with its SHA-256 in its record."""
    return data.replace(UNSEALED, hashlib.sha256(data).hexdigest().encode())


class PoseNetwork:
    """A network in memory."""

    def __init__(self, data: bytes, name: str, codes: np.ndarray) -> None:
        """Read an ONNX file's content; ``name`` is for messages, ``codes`` ``(N, 3)`` uint8 are the case's frame's."""
        self.record = NetworkRecord.of_file(data, name)
        self._range = np.quantile(codes, (DARKEST, BRIGHTEST), axis=0)
        found: object
        try:
            self._network = cv2.dnn.readNetFromONNX(np.frombuffer(data, np.uint8))
            found = self.output(np.zeros((1, MULTIPLE, 2 * MULTIPLE, 3), np.uint8)).shape
        except cv2.error as error:
            found = " ".join(str(error.err or error).split())[:200]
        if found != (1, 5, MULTIPLE // STRIDE, 2 * MULTIPLE // STRIDE):
            raise InputError(f"{name}: expected a whole network, OpenCV finds {found}; copy it or train it again")

    @classmethod
    def read(cls, path: Path, loaded: LoadedCase) -> Self:
        """Read the network of a case's surface."""
        frame = loaded.frame
        codes = to_uint8(frame.image[frame.valid])
        network = cls(read_content(path, "a network that oneframe train wrote"), path.name, codes)
        record, camera = network.record, loaded.case.camera
        if record.surface != geometry_hash(loaded.surface.mesh):
            raise InputError(
                f"{path.name}: expected a network of the case's surface, found that of another one; train it on views "
                f"of {loaded.case.path.name}"
            )
        zoom = camera.fx / camera.width * record.width / record.fx
        if not 1 / LARGEST_ZOOM < zoom < LARGEST_ZOOM:
            raise InputError(
                f"{path.name}: expected views with about the case's zoom, found {1 / zoom:.2g} times it; train it on "
                f"views of {loaded.case.path.name}"
            )
        return network

    def output(self, images: np.ndarray) -> np.ndarray:
        """``(B, H, W, 3)`` uint8 -> ``(B, 5, H / 8, W / 8)``: coordinates, log of their error, logit of surface."""
        self._network.setInput(np.ascontiguousarray(network_input(images)))
        return self._network.forward()

    def poses(self, image: np.ndarray, camera: PinholeCamera) -> Iterator[np.ndarray]:
        """First poses of an image as :meth:`pose`, then of it in the range of the case's frame, as haze narrows it."""
        for look in (np.asarray, self._stretched):
            pose = self.pose(look(image), camera)
            if pose is not None:
                yield pose

    def _stretched(self, image: np.ndarray) -> np.ndarray:
        least, most = np.quantile(image.reshape(-1, 3), (DARKEST, BRIGHTEST), axis=0)
        share = (np.arange(256)[:, None] - least) / np.maximum(most - least, 1)
        return cv2.LUT(image, to_uint8((self._range[0] + share * (self._range[1] - self._range[0])) / 255)[None])

    def pose(self, image: np.ndarray, camera: PinholeCamera) -> np.ndarray | None:
        """``cam_from_model`` of an undistorted image ``(H, W, 3)`` uint8, if it finds one.

        The network sees the image at the focal length of its views.
        """
        scale = self.record.fx / camera.fx
        seen = camera.resized(round(scale * camera.width), round(scale * camera.height))
        pixels, points, errors = self.seen(cv2.resize(image, seen.size_wh, interpolation=cv2.INTER_AREA))
        reach_mm, centre = self.record.reach_mm, np.array(self.record.centre_model)
        return pose_of(points * reach_mm + centre, pixels, errors * reach_mm, seen)

    def seen(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What the network sees in an image ``(H, W, 3)`` uint8 and in turned copies, where it shows the surface.

        Returns
        -------
        ``(N, 2)`` pixels, ``(N, 3)`` coordinates, and ``(N,)`` the error that the network states of them.
        """
        height, width = image.shape[:2]
        padded_wh = -(-width // MULTIPLE) * MULTIPLE, -(-height // MULTIPLE) * MULTIPLE
        turns = [cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), turn, 1.0) for turn in TURNS_DEG]
        copies = [cv2.warpAffine(image, turn, padded_wh, borderMode=cv2.BORDER_REPLICATE) for turn in turns]
        output = self.output(np.stack(copies)).transpose(0, 2, 3, 1)
        v, u = STRIDE * np.mgrid[: output.shape[1], : output.shape[2]] + (STRIDE - 1) / 2
        cells = np.stack([u, v], axis=-1)
        pixels = np.stack([cv2.transform(cells, cv2.invertAffineTransform(turn)) for turn in turns])
        shown = (output[..., 4] > LEAST_LOGIT) & (np.abs(output[..., :4]) < FARTHEST).all(axis=-1)
        shown &= ((pixels >= 0) & (pixels <= (width - 1, height - 1))).all(axis=-1)
        return pixels[shown], output[shown][:, :3].astype(float), np.exp(output[shown][:, 3].astype(float))


def network_input(images: np.ndarray) -> np.ndarray:
    """``(B, H, W, 3)`` uint8 -> ``(B, 3, H, W)`` float32, -2..2."""
    return images.transpose(0, 3, 1, 2).astype(np.float32) / 64 - 2


def pose_of(points: np.ndarray, pixels: np.ndarray, errors_mm: np.ndarray, camera: PinholeCamera) -> np.ndarray | None:
    """``cam_from_model`` from ``(N, 3)`` points, mm, at ``(N, 2)`` pixels, with ``(N,)`` the errors they state."""
    sure = errors_mm <= np.quantile(errors_mm, SUREST) if len(points) else np.zeros(0, bool)
    if np.count_nonzero(sure) < FEWEST:
        return None
    points, pixels, errors_mm = points[sure], pixels[sure], errors_mm[sure]
    pivot = points.mean(axis=0)
    extent = np.linalg.norm(points - pivot, axis=1).mean() / np.linalg.norm(pixels - pixels.mean(axis=0), axis=1).mean()
    found, turn, position, _ = cv2.solvePnPRansac(
        points - pivot, pixels, camera.k, np.zeros(0),
        reprojectionError=float(max(OUTLIER * np.median(errors_mm) / extent, 1.0)),
        iterationsCount=1000, confidence=0.9999, flags=cv2.SOLVEPNP_SQPNP,
    )  # fmt: skip
    if not found or not np.isfinite(turn).all() or not np.isfinite(position).all():
        return None
    rotation, position = cv2.Rodrigues(turn)[0], position[:, 0]

    def residuals(twist: np.ndarray) -> np.ndarray:
        placed = (points - pivot) @ (rotation_from_vector(twist[3:]) @ rotation).T + position + twist[:3]
        # outliers may lie behind the camera
        placed[:, 2] = np.maximum(placed[:, 2], NEAREST_MM)
        scale_px = errors_mm * camera.fx / placed[:, 2]
        return ((camera.project(placed) - pixels) / scale_px[:, None]).ravel()

    twist = least_squares(residuals, np.zeros(6), loss="soft_l1", x_scale=[1, 1, 10, 0.1, 0.1, 0.1]).x
    rotation, position = rotation_from_vector(twist[3:]) @ rotation, position + twist[:3]
    return rigid(rotation, position - rotation @ pivot)
