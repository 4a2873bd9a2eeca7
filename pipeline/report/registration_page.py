"""The page of a registration: frames with their overlays and states, and where it may be wrong."""

import math

import numpy as np

from ..files.numbers import format_two_digits
from ..images.pixel_values import to_uint8
from ..registration.register_case import FrameEvidence, RegistrationEvidence
from ..registration.verdict import BLOCK_PX, COLOURS, WITHIN_DEG, WITHIN_PX, WITHIN_SHARE
from .page import Column, Item, html_page, lines_of, picture_of, webp

COLUMNS = (
    Column("state_word", "State", "whether the pose is accepted"),
    Column("probability", "Probability", "that the pose is right", 3),
    Column("image_px", "In the image", "standard deviation of the place of what is drawn", 2, " px"),
    Column("rotation_deg", "Rotation", "standard deviation about the least certain axis", 2, "°"),
    Column("position_mm", "Position", "standard deviation along the least certain axis", 2, " mm"),
)
CHANGED = 0.85, 0.1, 0.1
"""The colour over what has changed, sRGB."""


def registration_page(evidence: RegistrationEvidence, *, name: str) -> bytes:
    """Make the page.

    It names neither the case nor the frames: such names may be those of patients.
    """
    frames, (height, width, _), counts = evidence.frames, evidence.image.shape, evidence.counts
    facts = [f"{len(frames)} frames{' of a video' if evidence.is_film else ''}"]
    facts += [f"{counts[state]} {state}" for state in COLOURS]
    facts += [
        f"registered at {width} × {height} px",
        f"right means within {WITHIN_DEG:g}°, {100 * WITHIN_SHARE:g} % of the distance and {WITHIN_PX:g} px",
    ]
    sections = [("Where it may be wrong", lines_of(_limits(evidence)))]
    if evidence.change is not None:
        changed = evidence.change.blocks.repeat(BLOCK_PX, axis=0).repeat(BLOCK_PX, axis=1)[:height, :width, None]
        picture = to_uint8(np.where(changed, (evidence.image + CHANGED) / 2, evidence.image))[..., ::-1]
        sections.append(("What no longer looks as it did", picture_of(webp(picture, width, 80), "The case's frame")))
    if evidence.colouring_lines:
        lines = [*evidence.colouring_lines, "A frame colours what the case's own and those before it did not see."]
        sections.append(("Frames that colour the surface", lines_of(lines)))
    items = [_item(frame) for frame in frames]
    return html_page(name, "registration", facts, COLUMNS, items, layers=("Overlay",), sections=sections)


def _item(frame: FrameEvidence) -> Item:
    # nothing is certain: not 1.000
    figures: dict[str, float | str] = {
        "state_word": frame.verdict.state,
        "probability": math.floor(1000 * frame.verdict.probability) / 1000,
    }
    uncertainty = frame.registered.uncertainty
    if uncertainty is not None:
        figures |= {"image_px": frame.image_px, "rotation_deg": uncertainty.largest_rotation_deg}
        figures["position_mm"] = float(np.sqrt(np.linalg.eigvalsh(uncertainty.covariance[:3, :3])[-1]))
    return Item(str(frame.number), (frame.picture,), figures, frame.verdict.reason, frame.verdict.state)


def _limits(evidence: RegistrationEvidence) -> list[str]:
    record = evidence.alignment
    own = "; it states no error" if record.error_px is None else f"; it states {format_two_digits(record.error_px)} px"
    return [
        *([f"The video's {evidence.cut_off.removeprefix('the ')}."] if evidence.cut_off else []),
        f"All poses follow the case's own one: where that is off, all are off by as much{own}. "
        "Look at its overlay first.",
        *([f"The case's pose itself is in doubt: {record.doubt}"] if record.doubt else []),
        *([] if evidence.change is None else [evidence.change.words()]),
        "The surface is taken for right: depths, structures and colours are no better than it is.",
        "Where it is drilled meanwhile, a film says so only of places that it showed before from the same side; single "
        "frames say nothing.",
        "One K is taken for all frames, by the standard deviations too: a zoom by less than their scatter looks like "
        "another distance.",
        "The probability was calibrated on few scenes. It says little of surfaces unlike these.",
        "A refused frame may well show the surface: it was not found, no more.",
    ]
