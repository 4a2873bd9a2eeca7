"""Views of a pack by the package webdataset, without any code of OneFrame."""

import json
from collections.abc import Iterable, Iterator
from io import BytesIO
from typing import Any

import cv2
import numpy as np
import webdataset as wds


def image(data: bytes) -> np.ndarray:
    """A PNG or JPEG file as it is stored, BGR if it has colours."""
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)


def mask(data: bytes) -> np.ndarray:
    """The (H, W) bool mask of the first object: run lengths down the columns, zeros first."""
    entry = json.load(BytesIO(data))["0"]
    height, width = entry["size"]
    values = np.arange(len(entry["counts"])) % 2 == 1
    return np.repeat(values, entry["counts"]).reshape(width, height).T


def view(sample: dict[str, Any]) -> dict[str, Any]:
    """The arrays of a view, from the bytes of its members."""
    camera, (truth,), (info,) = (json.loads(sample[f"{name}.json"]) for name in ("camera", "gt", "gt_info"))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.reshape(truth["cam_R_m2c"], (3, 3)), truth["cam_t_m2c"]
    rgb = sample.get("rgb.png") or sample["rgb.jpg"]
    return {
        "key": sample["__key__"],
        "rgb": image(rgb)[..., ::-1],
        "depth_mm": image(sample["depth.png"]).astype(np.float32) * camera["depth_scale"],
        "mask": mask(sample["mask_visib.json"]),
        "observed": mask(sample["mask_observed.json"]),
        "k": np.reshape(camera["cam_K"], (3, 3)),
        "cam_from_model": pose,
        "bbox_visib": info["bbox_visib"],
    }


def views(shards: str | Iterable[str]) -> Iterator[dict[str, Any]]:
    """All views of shards, such as ``"packed/shard-{000000..000099}.tar"``, in random order of the shards."""
    return iter(wds.WebDataset(shards, shardshuffle=100).map(view))
