"""The page that shows a dataset: its views, poses and distributions, what the checker found, and provenance."""

import hashlib
import string
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import cv2
import numpy as np

from ..camera.pinhole import PinholeCamera
from ..case.case_file import Case
from ..dataset.check.check_dataset import CheckReport
from ..dataset.dataset_file import Description, read_description
from ..dataset.layout import MODEL_FILES, RECORD, ViewPaths
from ..dataset.model_file import read_model
from ..errors import InputError
from ..files.content import read_content
from ..images.image_check import check_image
from ..progress import Progress
from ..surface.mesh import TriangleMesh
from ..transforms import checked_rigid
from .check_section import badge, check_section
from .dataset_views import ShownView, shown_message, shown_view
from .page import asset, html_page, page_footer, page_header, poses_section, spaced
from .provenance import part_of, provenance_section
from .surface_sides import surface_sides
from .thumbnails import PAGE_BYTES, TEXT_PER_BYTE, base64_text, fitted, limited_picture
from .view_geometry import SourceFrame, pose_data

OVERLAY = "overlay.png"
FRAME_BYTES = 600_000
"""Room for the source frame, and for its overlay, as text."""
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

    root: Path
    description: Description
    surface: tuple[TriangleMesh, np.ndarray] | None
    source: SourceFrame
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
        The dataset's folder. What is missing or damaged of its views and its model is named on the page.
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
    page = _read(root)
    frames = _frames(page, case)
    description, camera = page.description, page.description.camera
    sample = list(range(description.count))
    if 0 < views < description.count:
        sample = sorted(set(np.linspace(0, description.count - 1, views).round().astype(int).tolist()))
    shown = fitted(
        sample,
        lambda index, quality: shown_view(root, index, quality),
        lambda view: view.size * TEXT_PER_BYTE,
        most_bytes=most_bytes,
        progress=lambda count: Progress(count, "views", stream=stream),
    )
    for view in shown:
        page.problems.extend(view.problems)
    options = part_of(description.content, "options")
    facts = [
        f"{spaced(description.count)} views",
        f"object {description.name}",
        f"{camera.width} × {camera.height} px",
        f"{options['engine']}, {options['colour']}" if {"engine", "colour"} <= options.keys() else "",
        f"sampler {options['sampler']}" if "sampler" in options else "",
        f"shown: {spaced(len(sample))}, evenly spaced" if len(sample) < description.count else "",
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
        poses=poses_section("view"),
        check=check_section(check, page.problems),
        provenance=provenance_section(description),
        footer=page_footer(),
    )
    data = {
        "quantities": QUANTITIES,
        "noun": "view",
        "coloured": "observed",
        "size": camera.size_wh,
        "views": [_view_data(view, page) for view in shown],
        "source": page.source.data(),
        "sides": surface_sides(page.surface, page.source),
        "frames": frames,
    }
    title = f"{resolved.name} · OneFrame dataset"
    return html_page(title=title, body=body, data=data, scripts=SCRIPTS)


def _read(root: Path) -> _Page:
    description, problems, surface = read_description(root / RECORD), [], None
    try:
        mesh, colours = read_model(root, MODEL_FILES[0])
        surface = mesh, np.full((len(mesh.vertices), 3), 200, np.uint8) if colours is None else colours
    except InputError as error:
        problems.append(shown_message(error, root))
    given, where = part_of(description.content, "frame"), f"{root / RECORD}: frame"
    try:
        k = [[given["fx"], 0, given["cx"]], [0, given["fy"], given["cy"]], [0, 0, 1]]
        camera = PinholeCamera.from_matrix(k, size=(given["width"], given["height"]), where=where)
        pose, _ = checked_rigid(given["cam_from_model"], where)
    except KeyError as missing:
        raise InputError(f"{where}: expected a key {missing}, it is missing; copy the dataset again") from None
    source = SourceFrame.of(camera, pose, None if surface is None else surface[0])
    return _Page(root, description, surface, source, problems)


def _view_data(view: ShownView, page: _Page) -> dict[str, object]:
    data: dict[str, object] = {
        "index": view.index,
        "file": ViewPaths(page.root, view.index).relative("rgb"),
        "picture": None if view.picture is None else base64_text(view.picture),
        "layers": None if view.layers is None else base64_text(view.layers),
        "range": None if view.range_mm is None else [round(value, 3) for value in view.range_mm],
        "problems": view.problems,
    }
    if view.record is None:
        return data
    pose, visible = view.record.cam_from_model, view.record.gt_info.px_count_visib
    data |= pose_data(pose)
    data["angle"] = round(page.source.angle_deg(pose), 3)
    data["distance"] = round(page.source.distance_of(pose), 3)
    if visible > 0:
        data["observed"] = round(100 * view.record.px_count_observed / visible, 2)
    camera = page.description.camera
    data["surface"] = round(100 * visible / (camera.width * camera.height), 2)
    return data


def _frames(page: _Page, case: Case | None) -> dict[str, object]:
    """The source frame and its overlay, as far as their files are there."""
    note, frames = [], []
    if case is not None:
        data = read_content(case.image, "the frame of the case")
        known = part_of(page.description.content, "inputs_sha256").get("frame")
        if known is not None and hashlib.sha256(data).hexdigest() != known:
            note.append(
                "This is another frame than the one that was rendered: its SHA-256 differs from dataset.json's."
            )
        if case.distortion is not None:
            note.append("The frame is shown as it was taken; overlay and views are undistorted.")
        frames.append({"name": "Frame", **_frame(data, case.image.name)})
    try:
        data = read_content(page.root / OVERLAY, "the overlay of the frame", OVERLAY)
        frames.append({"name": "Overlay", **_frame(data, OVERLAY)})
    except InputError as error:
        page.problems.append(shown_message(error, page.root))
    if case is None and frames:
        note.append("The frame itself is not part of a dataset; --case CASE.toml adds it.")
    return {"pictures": frames, "note": " ".join(note)}


def _frame(data: bytes, name: str) -> dict[str, object]:
    check_image(data, name)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{name}: expected an image, found a damaged one; copy it again")
    return limited_picture(image, FRAME_BYTES)
