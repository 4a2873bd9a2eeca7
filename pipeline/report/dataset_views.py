"""The views of a dataset for a page, read tolerantly: what is missing or damaged is named, and the rest is shown."""

from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from ..dataset.check.findings import printable
from ..dataset.layout import ViewPaths, largest_view_file
from ..dataset.run.resume_record import ViewRecord, read_record
from ..errors import InputError, RunError
from ..files.content import read_content
from ..images.image_check import LARGEST_IMAGE, check_image
from .thumbnails import Quality, shrunk, webp
from .view_layers import ViewLayers


def shown_message(error: object, root: Path) -> str:
    """A message with paths relative to the folder: a page that is passed on tells nothing of this computer."""
    return printable(str(error).replace(f"{root}/", "").replace(str(root), root.name))


@dataclass(frozen=True)
class ShownView:
    """A view for the page.

    Attributes
    ----------
    index
        Its number.
    record
        ``None`` if it is missing or damaged.
    picture, layers
        Encoded: colours, and depth with masks (:mod:`oneframe.report.view_layers`).
    range_mm
        Nearest and farthest depth.
    problems
        What is missing or damaged.
    """

    index: int
    record: ViewRecord | None = None
    picture: bytes | None = None
    layers: bytes | None = None
    range_mm: tuple[float, float] | None = None
    problems: list[str] = field(default_factory=list)

    @property
    def size(self) -> int:
        """Bytes of the pictures."""
        return len(self.picture or b"") + len(self.layers or b"")


def shown_view(root: Path, index: int, quality: Quality) -> ShownView:
    """Read a view and encode its pictures."""
    paths, problems = ViewPaths(root, index), []
    record = None
    try:
        record = read_record(paths, with_mask=False)
    except RunError as error:
        if not paths.file("frame").exists() and not paths.file("rgb").exists():
            return ShownView(index, problems=[f"{paths.relative('frame')}: the view is missing"])
        problems.append(shown_message(error, root).partition("; ")[0])
    picture = _image(paths, "rgb", problems)
    depth, mask, observed = (_image(paths, kind, problems) for kind in ("depth", "mask_visib", "mask_observed"))
    shapes = {image.shape[:2] for image in (picture, depth, mask, observed) if image is not None}
    if len(shapes) > 1:
        problems.append(f"{paths.relative('rgb')}: the view's images differ in size")
        depth = mask = observed = None
    layers = ViewLayers(
        None if depth is None else depth.astype(np.float32) * (1.0 if record is None else record.depth_scale),
        None if mask is None else mask > 0,
        None if observed is None else observed > 0,
    )
    return ShownView(
        index,
        record,
        None if picture is None else webp(shrunk(picture, quality.width_px), quality.webp),
        layers.encoded(quality.layer_width_px),
        None if record is None else layers.range_mm(),
        problems,
    )


def _image(paths: ViewPaths, kind: str, problems: list[str]) -> np.ndarray | None:
    """An image as OpenCV decodes it: BGR, or one channel; ``None`` with an entry in ``problems`` if that fails."""
    name = paths.relative(kind)
    if not paths.file(kind).exists():
        problems.append(f"{name}: the file is missing")
        return None
    try:
        data = read_content(paths.file(kind), "an image of the view", name, most=largest_view_file(LARGEST_IMAGE, 1))
        check_image(data, name)
    except InputError as error:
        problems.append(shown_message(error, paths.root))
        return None
    flags = cv2.IMREAD_COLOR if kind == "rgb" else cv2.IMREAD_UNCHANGED
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if image is None or (kind != "rgb" and image.ndim != 2):
        problems.append(f"{name}: expected an image of the view, found a damaged one")
        return None
    return image
