"""Tables of images that other programs write, as the entries of a list of photographs.

BOP's ``scene_gt.json`` and ``scene_camera.json``, and COLMAP's ``images.txt`` beside its ``cameras.txt``. An entry has
its ``image`` and ``camera`` relative to the table, and :data:`POSE_KEY`.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.numbers import number_rows
from ..transforms import cross_matrices, rigid

POSE_KEY, NO_SCALE = "cam_from_mesh", "no_scale"
"""Keys of a pose, and of whether its unit is its program's own."""
CAMERAS = "scene_camera.json"
PICTURES = ("rgb/{:06d}.png", "rgb/{:06d}.jpg", "gray/{:06d}.png")
"""Where BOP has the image of a number; the first that exists."""
FOLDERS = (".", "images", "../images", "../../images")
"""Where COLMAP's images are, which it does not say, from the folder of its model."""


def is_scene(table: object) -> bool:
    """Whether a table of JSON is of BOP: what it says of each image stands under the image's number."""
    return isinstance(table, Mapping) and bool(table) and all(str(key).isdecimal() for key in table)


def scene_entries(scene: Mapping[str, Any], path: Path, place: str) -> list[dict[str, Any]]:
    """Entries of BOP's ``scene_gt.json``; of ``scene_camera.json`` without poses.

    ``place`` is ``"IMAGE"``, ``"/OBJECT"``, ``"IMAGE/OBJECT"``, or empty for all of them.
    """
    number, _, wanted = place.partition("/")
    entries = []
    for image, truths in scene.items():
        if number not in ("", image):
            continue
        poses: list[Any] = [None]
        try:
            named = [name.format(int(image)) for name in PICTURES]
            if not isinstance(truths, Mapping):
                own = [each for each in truths if not wanted or f"{each['obj_id']:g}" == wanted]
                poses = [rigid(np.reshape(each["cam_R_m2c"], (3, 3)), each["cam_t_m2c"]).tolist() for each in own]
        except (KeyError, TypeError, ValueError):
            raise InputError(
                f"{path.name}: image {image[:20]}: expected obj_id, cam_R_m2c and cam_t_m2c of each object, as in BOP"
            ) from None
        if len(poses) > 1:
            which = f"write which after #: {path.name}#/OBJECT of all images, {path.name}#{image}/OBJECT of one"
            raise InputError(
                f"{path.name}: image {image}: expected one object, found {len(poses)}; "
                f"{'keep one of them, as both have this number' if wanted else which}"
            )
        entry = {"image": next((each for each in named if (path.parent / each).is_file()), named[0])}
        entry |= {"camera": f"{CAMERAS}#{image}"} if (path.parent / CAMERAS).is_file() else {}
        entries += [entry | {POSE_KEY: pose} for pose in poses]
    return entries


def is_colmap(lines: Sequence[str]) -> bool:
    """Whether lines are those of ``images.txt``: IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, and those of points."""
    words = lines[0].split(maxsplit=9) if lines else []
    return len(words) == 10 and number_rows(" ".join(words[:9])) is not None and number_rows(words[9]) is None


def colmap_entries(lines: Sequence[str], path: Path, place: str) -> list[dict[str, Any]]:
    """Entries of ``images.txt``, in which ``place`` is an image's name; empty for all."""
    if any(len(points.split()) % 3 or is_colmap([points]) for points in lines[1::2]):
        raise InputError(f"{path.name}: expected two lines for each image, as COLMAP writes them; export it again")
    entries = []
    for line in lines[::2]:
        words = line.strip().split(maxsplit=9)
        numbers = number_rows(" ".join(words[1:8]))
        length = 0.0 if numbers is None or len(numbers) != 7 else math.hypot(*numbers[:4])
        if len(words) != 10 or numbers is None or not 0.99 < length < 1.01:
            raise InputError(
                f"{path.name}: expected ten words in each image's line, of them a quaternion of length 1, as COLMAP "
                "writes them; export it again"
            )
        real, *axis = numbers[:4] / length
        cross = cross_matrices(np.array(axis))
        pose = rigid(np.eye(3) + 2 * real * cross + 2 * cross @ cross, numbers[4:7])
        if place in ("", words[9]):
            camera = f"cameras.txt#camera {words[8]}"
            entries.append({"image": words[9], "camera": camera, POSE_KEY: pose.tolist(), NO_SCALE: True})
    folder = next((each for each in FOLDERS if entries and (path.parent / each / entries[0]["image"]).is_file()), ".")
    return [entry | {"image": f"{folder}/{entry['image']}"} for entry in entries]
