"""The page of a registration: states over time, frames with their overlays, poses, and where it may be wrong."""

import math
import string

import numpy as np

from ..colour.vertex_colours import colour_vertices
from ..files.numbers import format_two_digits
from ..registration.colour_sources import ColourChoice
from ..registration.report import COLOURS, FrameEvidence, RegistrationEvidence
from ..registration.surface_check import LEAST_ANGLE_DEG, LEAST_FRAMES, SurfaceCheck
from ..registration.verdict import WITHIN_DEG, WITHIN_PX, WITHIN_SHARE
from .page import asset, findings, html_page, page_footer, page_header, poses_section, spaced
from .surface_sides import surface_sides
from .thumbnails import base64_text
from .view_geometry import SourceFrame, pose_data

SCRIPTS = ("elements.js", "table.js", "poses.js", "registration.js")
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
    """
    frames, camera, counts = evidence.frames, evidence.source.camera, evidence.counts
    facts = [f"{spaced(len(frames))} frames{' of a video' if evidence.is_film else ''}"]
    facts += [f"{spaced(counts[state])} {state}" for state in COLOURS]
    facts += [f"registered at {camera.width} × {camera.height} px"]
    body = string.Template(asset("registration.html")).substitute(
        header=page_header(kind="registration", name=name, facts=facts),
        within=f"{WITHIN_DEG:g}°, {100 * WITHIN_SHARE:g} % of the distance and {WITHIN_PX:g} px",
        poses=poses_section("frame"),
        limits=findings(_limits(evidence)),
        colour=_colour(evidence.colour),
        footer=page_footer(),
    )
    source = SourceFrame(camera, evidence.source.cam_from_model, evidence.pivot_model)
    colours = np.rint(255 * colour_vertices(evidence.mesh, [evidence.source]).rgb).astype(np.uint8)
    data = {
        "noun": "frame",
        "isFilm": evidence.is_film,
        "quantities": QUANTITIES,
        "coloured": "state",
        "colours": COLOURS,
        "counts": counts,
        "size": camera.size_wh,
        "views": [_frame_data(frame) for frame in frames],
        "source": source.data(),
        "sides": surface_sides((evidence.mesh, colours), source),
        "lost": evidence.lost,
    }
    title = f"{name} · OneFrame registration"
    return html_page(title=title, body=body, data=data, scripts=SCRIPTS)


def _frame_data(frame: FrameEvidence) -> dict[str, object]:
    data: dict[str, object] = {
        "index": frame.number,
        "state": frame.verdict.state,
        # nothing is certain: not 1.000
        "probability": math.floor(1000 * frame.verdict.probability) / 1000,
        "reason": frame.verdict.reason,
        "picture": None if frame.picture is None else base64_text(frame.picture),
    }
    if frame.cam_from_model is not None:
        data |= pose_data(frame.cam_from_model)
        data |= {key: round(getattr(frame, key), 4) for key in ("image_px", "rotation_deg", "position_mm")}
    return data


def _doubt_of_surface(check: SurfaceCheck | None) -> str:
    if check is None:
        return (
            f"The surface is taken for right: to check it takes {LEAST_FRAMES} accepted frames over "
            f"{LEAST_ANGLE_DEG:g}°."
        )
    if check.words:
        return f"{check.words[:1].upper()}{check.words[1:]}: so are depths and colours there. See frames.png."
    told = np.isfinite(check.off_mm).mean()
    return f"The surface is where {check.frames} frames see it, as far as they tell: of {told:.0%} of the case's frame."


def _colour(choice: ColourChoice | None) -> str:
    if choice is None:
        return ""
    title = '<h2 id="colour-title">Frames that colour the surface</h2>'
    lines = [*choice.lines(), "A frame colours what the case's own and those before it did not see."]
    return f'<section id="colour" class="card" aria-labelledby="colour-title">{title}{findings(lines)}</section>'


def _limits(evidence: RegistrationEvidence) -> list[str]:
    record = evidence.alignment
    error = record.get("error_px")
    own = f"; it states {format_two_digits(error)} px" if isinstance(error, float) else "; it states no error"
    return [
        *([f"The video's {evidence.cut_off.removeprefix('the ')}."] if evidence.cut_off else []),
        f"All poses follow the case's own one: where that is off, all are off by as much{own}. "
        "Look at its overlay first.",
        *([f"The case's pose itself is in doubt: {record['doubt']}"] if "doubt" in record else []),
        *([] if evidence.change is None else [evidence.change.words()]),
        _doubt_of_surface(evidence.surface),
        "Where it is drilled meanwhile, a film says so only of places that it showed before from the same side; single "
        "frames say nothing.",
        "One K is taken for all frames: a zoom by less than their scatter looks like another distance.",
        "The probability was calibrated on few scenes. It says little of surfaces unlike these.",
        "The standard deviations are too small under motion blur.",
        "A refused frame may well show the surface: it was not found, no more.",
    ]
