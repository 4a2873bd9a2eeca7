"""The page that shows a dataset: its views, poses and distributions, what the checker found, and provenance."""

import hashlib
import string
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import cv2
import numpy as np

from ..case.case_file import Case
from ..dataset.check.check_dataset import CheckReport
from ..dataset.layout import ViewPaths
from ..errors import InputError
from ..files.content import read_content
from ..images.image_check import check_image
from ..progress import Progress
from ..transforms import camera_centre
from .check_section import badge, check_section
from .dataset_views import DatasetFolder, ShownView, open_dataset, shown_message, shown_view
from .page import THREE, asset, html_page, page_footer, page_header, spaced
from .provenance import provenance_section
from .surface_model import ColouredSurface, read_surface
from .thumbnails import PAGE_BYTES, TEXT_PER_BYTE, base64_text, fitted, limited_picture
from .view_geometry import SourceFrame

OVERLAY = "overlay.png"
FRAME_BYTES = 600_000
"""Of the source frame and of its overlay, as text."""
SCRIPTS = ("elements.js", "slider.js", "histogram.js", "layers.js", "poses.js", "dataset.js")

QUANTITIES = (
    {
        "key": "angle", "name": "Angle", "unit": "°", "digits": 1,
        "about": "between the view's camera and the source frame's, seen from the pivot: the surface point in the "
        "middle of the source frame",
    },
    {"key": "distance", "name": "Distance", "unit": " mm", "digits": 0, "about": "from the camera to the pivot"},
    {
        "key": "observed", "name": "Observed", "unit": " %", "digits": 1,
        "about": "share of the surface in the view that the source frame saw",
    },
    {"key": "surface", "name": "Surface", "unit": " %", "digits": 1, "about": "share of the view that shows surface"},
)  # fmt: skip
"""What views are sorted, filtered and coloured by."""


@dataclass(frozen=True)
class _Page:
    """What the parts of the page share."""

    folder: DatasetFolder
    surface: ColouredSurface | None
    source: SourceFrame | None
    problems: list[str]


def dataset_page(
    root: Path,
    *,
    views: int = 0,
    check: CheckReport | None = None,
    case: Case | None = None,
    most_bytes: int = PAGE_BYTES,
    stream: TextIO | None = None,
) -> bytes:
    """Make the page.

    Parameters
    ----------
    root
        The dataset's folder. What is missing or damaged in it is named on the page.
    views
        Show this many views, evenly spaced; 0 for all.
    check
        What the checker found; ``None`` if it did not run.
    case
        The case that was rendered, for its frame.
    most_bytes
        Of all pictures of views together, as text.
    stream
        Stream for the progress.

    Raises
    ------
    InputError
        No dataset, or one of another format.
    """
    folder = open_dataset(root)
    page = _read(folder)
    frames = _frames(page, case)
    sample = folder.sample(views)
    shown = fitted(
        sample,
        lambda index, quality: shown_view(root, index, quality),
        lambda view: view.size * TEXT_PER_BYTE,
        most_bytes=most_bytes,
        progress=lambda count: Progress(count, "views", stream=stream),
    )
    for view in shown:
        page.problems.extend(view.problems)
    camera = folder.camera
    size = "" if camera is None else f"{camera.width} × {camera.height} px"
    options = folder.part("options")
    facts = [
        f"{spaced(folder.count)} views",
        f"object {folder.description['object']}" if "object" in folder.description else "",
        size,
        f"{options['engine']}, {options['colour']}" if {"engine", "colour"} <= options.keys() else "",
        f"sampler {options['sampler']}" if "sampler" in options else "",
        f"shown: {spaced(len(sample))}, evenly spaced" if len(sample) < folder.count else "",
    ]
    resolved = root.resolve()
    header = page_header(
        kind="dataset",
        name=resolved.name,
        facts=[fact for fact in facts if fact],
        status=badge(check),
    )
    body = string.Template(asset("dataset.html")).substitute(
        header=header,
        check=check_section(check, page.problems),
        provenance=provenance_section(folder),
        footer=page_footer(),
    )
    data = {
        "quantities": QUANTITIES,
        "camera": None if camera is None else [camera.width, camera.height, *camera.k.ravel()[[0, 4, 2, 5]].tolist()],
        "views": [_view_data(view, page) for view in shown],
        "source": None if page.source is None else _source_data(page.source),
        "surface": None if page.surface is None else page.surface.reduced().packed(),
        "frames": frames,
    }
    title = f"{resolved.name} · OneFrame dataset"
    return html_page(title=title, body=body, data=data, scripts=SCRIPTS, libraries=(THREE,))


def _read(folder: DatasetFolder) -> _Page:
    problems, surface = list(folder.problems), None
    try:
        surface = read_surface(folder.root)
    except InputError as error:
        problems.append(shown_message(error, folder.root))
    source = None
    if folder.source is not None:
        camera, pose = folder.source
        source = SourceFrame.of(camera, pose, None if surface is None else surface.mesh)
    elif folder.description:
        problems.append("dataset.json: expected the camera and the pose of the frame, found none")
    return _Page(folder, surface, source, problems)


def _view_data(view: ShownView, page: _Page) -> dict[str, object]:
    data: dict[str, object] = {
        "index": view.index,
        "file": ViewPaths(page.folder.root, view.index).relative("rgb"),
        "picture": None if view.picture is None else base64_text(view.picture),
        "layers": None if view.layers is None else base64_text(view.layers),
        "range": None if view.range_mm is None else [round(value, 3) for value in view.range_mm],
        "problems": view.problems,
    }
    if view.record is None:
        return data
    pose, visible = view.record.cam_from_model, view.record.gt_info.px_count_visib
    data["centre"] = np.round(camera_centre(pose), 4).tolist()
    data["rotation"] = np.round(pose[:3, :3], 6).ravel().tolist()
    if page.source is not None:
        data["angle"] = round(page.source.angle_deg(pose), 3)
        data["distance"] = round(page.source.distance_of(pose), 3)
    if visible > 0:
        data["observed"] = round(100 * view.record.px_count_observed / visible, 2)
    if page.folder.camera is not None:
        data["surface"] = round(100 * visible / (page.folder.camera.width * page.folder.camera.height), 2)
    return data


def _source_data(source: SourceFrame) -> dict[str, object]:
    camera = source.camera
    return {
        "centre": camera_centre(source.cam_from_model).tolist(),
        "rotation": source.cam_from_model[:3, :3].ravel().tolist(),
        "pivot": source.pivot_model.tolist(),
        "distance": source.distance_mm,
        "camera": [camera.width, camera.height, *camera.k.ravel()[[0, 4, 2, 5]].tolist()],
    }


def _frames(page: _Page, case: Case | None) -> dict[str, object]:
    """The source frame and its overlay, as far as their files are there."""
    note, frames = [], []
    if case is not None:
        data = read_content(case.image, "the frame of the case")
        known = page.folder.part("inputs_sha256").get("frame")
        if known is not None and hashlib.sha256(data).hexdigest() != known:
            note.append(
                "This is another frame than the one that was rendered: its SHA-256 differs from dataset.json's."
            )
        if case.distortion is not None:
            note.append("The frame is shown as it was taken; overlay and views are undistorted.")
        frames.append({"name": "Frame", **_frame(data, case.image.name)})
    try:
        data = read_content(page.folder.root / OVERLAY, "the overlay of the frame", OVERLAY)
        frames.append({"name": "Overlay", **_frame(data, OVERLAY)})
    except InputError as error:
        page.problems.append(shown_message(error, page.folder.root))
    if case is None and frames:
        note.append("The frame itself is not part of a dataset; --case CASE.toml adds it.")
    return {"pictures": frames, "note": " ".join(note)}


def _frame(data: bytes, name: str) -> dict[str, object]:
    check_image(data, name)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{name}: expected an image, found a damaged one; copy it again")
    return limited_picture(image, FRAME_BYTES)
