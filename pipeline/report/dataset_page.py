"""The page that shows a dataset: its views with their truths, what the checker found, and where it comes from.

What is missing or damaged is named, and the rest is shown.
"""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TextIO

import cv2
import numpy as np

from ..dataset.check.check_dataset import CheckReport
from ..dataset.dataset_file import Description, read_description
from ..dataset.layout import RECORD, ViewPaths, evenly_spaced, largest_view_file
from ..dataset.run.resume_record import ViewRecord, read_record
from ..errors import InputError, RunError
from ..files.content import read_content
from ..images.image_check import LARGEST_IMAGE, check_image
from ..progress import Progress
from .page import Column, Item, escaped, html_page, lines_of, picture_of, webp

OVERLAY = "overlay.png"
PAGE_BYTES = 15_000_000
"""Room for all pictures of views, as text, so that a page of 1000 views stays below 20 MB."""
TEXT_PER_BYTE = 4 / 3
"""Growth of what is written as base64."""
WIDEST_PX, BYTES_PER_PIXEL, QUALITY = 960, 0.11, 70
"""Of a picture as WebP: its width at the most, and how many bytes a pixel takes at this quality, at the most."""
COLUMNS = (
    Column("angle", "Angle", "between the view's line of sight and the frame's", 1, "°"),
    Column("depth", "Depth", "median depth of the surface in view", 1, " mm"),
    Column("observed", "Observed", "share of the surface in the view that the frame saw", 1, " %"),
    Column("surface", "Surface", "share of the view that shows surface", 1, " %"),
)


def dataset_page(
    root: Path, *, views: int = 0, check: CheckReport | None = None, stream: TextIO | None = None
) -> bytes:
    """Make the page.

    Parameters
    ----------
    root
        The dataset's folder.
    views
        Show this many views, evenly spaced; 0 for all.
    check
        What the checker found; ``None`` if it did not run.
    stream
        Stream for the progress.
    """
    description = read_description(root / RECORD)
    numbers = evenly_spaced(description.count, views)
    width_px = _width_px(description, len(numbers))
    # OpenCV decodes and encodes without Python's lock
    with ThreadPoolExecutor(4) as pool, Progress(len(numbers), "views", stream=stream) as shown:
        items = []
        for item in pool.map(lambda number: _item(root, number, description, width_px), numbers):
            items.append(item)
            shown.advance()
    problems = [item.note for item in items if item.note]
    options, camera = description.content.get("options"), description.camera
    facts = [f"{description.count} views", f"object {description.name}", f"{camera.width} × {camera.height} px"]
    if isinstance(options, dict):
        facts += [f"{name} {options[name]}" for name in ("engine", "colour", "sampler") if name in options]
    if len(numbers) < description.count:
        facts.append(f"shown: {len(numbers)}, evenly spaced")
    sections = [("Check", _check(check, problems))]
    if (overlay := _image(root / OVERLAY, OVERLAY)) is not None:
        sections.append(("The frame with its overlay", picture_of(webp(overlay, WIDEST_PX, 85), "The frame")))
    given = json.dumps(description.content, indent=1, ensure_ascii=False)
    sections.append(("Provenance", f"<pre>{escaped(given)}</pre>"))
    return html_page(
        root.resolve().name, "dataset", facts, COLUMNS, items, layers=("Colour", "Truths"), sections=sections
    )


def _width_px(description: Description, count: int) -> int:
    """Width of pictures with which two of each view have room."""
    camera = description.camera
    pixels = PAGE_BYTES / TEXT_PER_BYTE / BYTES_PER_PIXEL / max(2 * count, 1)
    return int(min(WIDEST_PX, camera.width, np.sqrt(pixels * camera.width / camera.height)))


def _item(root: Path, number: int, description: Description, width_px: int) -> Item:
    paths, record, note = ViewPaths(root, number), None, ""
    try:
        record = read_record(paths)
    except RunError as error:
        note = _shown(error, root).partition("; ")[0]
    rgb, depth, observed = (
        _image(paths.file(kind), paths.relative(kind)) for kind in ("rgb", "depth", "mask_observed")
    )
    missing = [paths.relative(kind) for kind, image in (("rgb", rgb), ("depth", depth)) if image is None]
    if missing and not note:
        note = f"{missing[0]}: expected an image of the view, found none or a damaged one"
    colour = None if rgb is None or rgb.ndim != 3 else webp(rgb, width_px, QUALITY)
    truths = None
    if depth is not None and depth.ndim == 2:
        truths = webp(_truths_picture(depth, observed), width_px, QUALITY)
    figures = {} if record is None else _figures(record, depth, description)
    return Item(str(number), (colour, truths), figures, note)


def _figures(record: ViewRecord, depth: np.ndarray | None, description: Description) -> dict[str, float | str]:
    """Finite numbers by the keys of :data:`COLUMNS`."""
    camera, visible = description.camera, record.gt_info.px_count_visib
    figures: dict[str, float | str] = {"surface": 100 * visible / (camera.width * camera.height)}
    frame = description.content.get("frame")
    if isinstance(frame, dict) and "cam_from_model" in frame:
        given = np.array(frame["cam_from_model"], float).reshape(4, 4)
        cosine = float(np.clip(record.cam_from_model[2, :3] @ given[2, :3], -1, 1))
        figures["angle"] = float(np.degrees(np.arccos(cosine)))
    if visible > 0:
        figures["observed"] = 100 * record.px_count_observed / visible
    if depth is not None and (inside := depth > 0).any():
        figures["depth"] = float(np.median(depth[inside])) * record.depth_scale
    return figures


def _truths_picture(depth: np.ndarray, observed: np.ndarray | None) -> np.ndarray:
    """``(H, W, 3)`` uint8: depth in colours, near is bright; what the frame did not see is grey; black beside it."""
    inside = depth > 0
    levels = np.zeros(depth.shape, np.uint8)
    if inside.any():
        near, far = (float(end) for end in (depth[inside].min(), depth[inside].max()))
        levels[inside] = np.rint(255 - 200 * (depth[inside] - near) / max(far - near, 1e-9)).astype(np.uint8)
    picture = cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS)
    if observed is not None and observed.shape == depth.shape:
        unseen = inside & (observed == 0)
        picture[unseen] = levels[unseen][:, None] // 2
    picture[~inside] = 0
    return picture


def _image(path: Path, name: str) -> np.ndarray | None:
    """An image as OpenCV decodes it: BGR, or one channel; ``None`` if it is missing or damaged."""
    try:
        most = largest_view_file(LARGEST_IMAGE, 1)
        data = read_content(path, "an image of the view", name, most, noted=False)
        check_image(data, name)
    except InputError:
        return None
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)


def _check(check: CheckReport | None, problems: list[str]) -> str:
    """What the checker found, and what the page could not show, as HTML."""
    if check is None:
        head = "<p>The dataset was not checked for this page. <code>oneframe check</code> does it.</p>"
    elif not check.findings:
        head = f'<p class="good">Complete and consistent: {check.hashed} files with the right hash.</p>'
    else:
        head = f'<p class="bad">Not complete and consistent: {len(check.findings)} findings.</p>'
        head += lines_of([f"{kind}: {line}" for kind, lines in check.findings.first.items() for line in lines])
    return head + lines_of(problems[:50])


def _shown(error: object, root: Path) -> str:
    """A message with paths relative to the folder: a page that is passed on tells nothing of this computer."""
    return str(error).replace(f"{root}/", "").replace(str(root), root.name)
