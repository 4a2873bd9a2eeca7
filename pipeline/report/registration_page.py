"""The page of a registration: states over time, frames with their overlays, poses in 3D, and where it may be wrong."""

import string
from collections import Counter

import numpy as np

from .. import __version__
from ..colour.vertex_colours import colour_vertices
from ..files.numbers import format_two_digits
from ..registration.evidence import COLOURS, FrameEvidence, RegistrationEvidence, worst_frames
from ..registration.verdict import ACCEPTED, REFUSED, WITHIN_DEG, WITHIN_PX, WITHIN_SHARE
from .page import THREE, asset, escaped, html_page, page_footer, page_header, poses_section, property_table, spaced
from .surface_model import packed_surface
from .thumbnails import base64_text
from .view_geometry import SourceFrame, camera_data, pose_data

SCRIPTS = ("elements.js", "layers.js", "table.js", "poses.js", "registration.js")
WORST = 12
"""Rows of the table of what to look at first."""
QUANTITIES = (
    {"key": "state", "name": "State", "colours": COLOURS},
    {"key": "probability", "name": "Probability", "unit": "", "digits": 3, "about": "that the pose is right"},
    {
        "key": "image_px", "name": "In the image", "unit": " px", "digits": 2,
        "about": "standard deviation of the place of what is drawn, in px of the image that was registered",
    },
    {
        "key": "rotation_deg", "name": "Rotation", "unit": "°", "digits": 2,
        "about": "standard deviation about the least certain axis",
    },
    {
        "key": "position_mm", "name": "Position", "unit": " mm", "digits": 2,
        "about": "standard deviation along the least certain axis",
    },
)  # fmt: skip
"""What frames are described and coloured by."""


def registration_page(evidence: RegistrationEvidence, *, name: str) -> bytes:
    """Make the page.

    It names neither the case nor the frames: such names may be those of patients.

    Parameters
    ----------
    evidence
        What was found.
    name
        Of the registration.
    """
    frames, camera, worst = evidence.frames, evidence.source.camera, worst_frames(evidence.frames, WORST)
    counts = Counter(frame.verdict.state for frame in frames)
    facts = [f"{spaced(len(frames))} frames{' of a video' if evidence.is_film else ''}"]
    facts += [f"{spaced(counts[state])} {state}" for state in COLOURS]
    body = string.Template(asset("registration.html")).substitute(
        header=page_header(kind="registration", name=name, facts=facts),
        within=f"{WITHIN_DEG:g}°, {100 * WITHIN_SHARE:g} % of the distance and {WITHIN_PX:g} px",
        poses=poses_section("frame"),
        limits=_limits(evidence),
        done=property_table(_done(evidence), caption="Registration"),
        footer=page_footer(),
    )
    colours = np.rint(255 * colour_vertices(evidence.mesh, [evidence.source]).rgb).astype(np.uint8)
    data = {
        "noun": "frame",
        "isFilm": evidence.is_film,
        "quantities": QUANTITIES,
        "coloured": "state",
        "colours": COLOURS,
        "counts": {state: counts[state] for state in COLOURS},
        "camera": camera_data(camera),
        "views": [_frame_data(frame) for frame in frames],
        "source": SourceFrame(camera, evidence.source.cam_from_model, evidence.pivot_model).data(),
        "surface": packed_surface(evidence.mesh, colours),
        "worst": [{"place": place, "first": first, "last": last} for place, (first, last) in worst],
    }
    title = f"{name} · OneFrame registration"
    return html_page(title=title, body=body, data=data, scripts=SCRIPTS, libraries=(THREE,))


def _frame_data(frame: FrameEvidence) -> dict[str, object]:
    data: dict[str, object] = {
        "index": frame.number,
        "state": frame.verdict.state,
        "probability": round(frame.verdict.probability, 4),
        "reason": frame.verdict.reason,
        "picture": None if frame.picture is None else base64_text(frame.picture),
    }
    if frame.cam_from_model is not None:
        data |= pose_data(frame.cam_from_model)
        data |= {key: round(getattr(frame, key), 4) for key in ("image_px", "rotation_deg", "position_mm")}
    return data


def _done(evidence: RegistrationEvidence) -> list[tuple[str, str]]:
    frames, camera, record = evidence.frames, evidence.source.camera, evidence.alignment
    numbers = [frame.number for frame in frames]
    found = [frame.image_px for frame in frames if frame.verdict.state == ACCEPTED]
    rows = [
        ("tool", f"OneFrame {__version__}"),
        (
            "frames",
            f"{len(frames)}, {min(numbers)} to {max(numbers)} of {'a video' if evidence.is_film else 'a folder'}",
        ),
        ("registered at", f"{camera.width} × {camera.height} px"),
        ("surface", f"{spaced(len(evidence.mesh.faces))} triangles"),
        ("the case's pose", f"found by: {record.get('method', 'not recorded')}"),
    ]
    if found:
        rows.append(("accepted poses", f"median ± {format_two_digits(float(np.median(found)))} px"))
    return [(name, escaped(value)) for name, value in rows]


def _limits(evidence: RegistrationEvidence) -> str:
    record = evidence.alignment
    error = record.get("error_px")
    own = f"; it states {format_two_digits(error)} px" if isinstance(error, float) else "; it states no error"
    refused = sum(frame.verdict.state == REFUSED for frame in evidence.frames)
    lines = [
        f"All poses follow the case's own one: where that is off, all are off by as much{own}. "
        "A person should have looked at its overlay.",
        *([f"The case's pose itself is in doubt: {record['doubt']}"] if "doubt" in record else []),
        "The surface is taken for right. What was drilled since draws the poses with it.",
        "One K is taken for all frames: a zoom within the film looks like another distance.",
        "The probability was calibrated on few scenes. It says little of surfaces unlike these.",
        "The standard deviations are what each frame tells by itself, and rough.",
        *(["A refused frame may well show the surface: it was not found, no more."] if refused else []),
    ]
    return '<ul class="findings">' + "".join(f"<li>{escaped(line)}</li>" for line in lines) + "</ul>"
