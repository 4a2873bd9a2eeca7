"""The page of a corrected surface: the model to turn, in the colours of its deviation, and where it may be wrong."""

import string

import numpy as np

from ..case.loaded_case import LoadedCase
from ..images.pixel_values import to_uint8
from ..surface.decimation import reduced_mesh
from ..surface_correction.correct_surface import SurfaceCorrection
from ..surface_correction.deviation_map import NOTHING, deviation_colours, most_of
from ..surface_correction.surface_check import FARTHER, NEARER
from ..transforms import transform_points
from .page import asset, findings, html_page, page_footer, page_header
from .thumbnails import base64_text, shrunk, webp
from .view_geometry import SourceFrame

BADGE = '<a class="badge bad" href="#limits">For research only, must not guide a surgeon</a>'
MOST_VERTICES = 60_000
"""Of the model: numbers of 16 bits name them."""
FRAME_PX, QUALITY = 900, 85
LIMITS = (
    "For research only: it must not guide a surgeon. Some of what is confirmed may be wrong.",
    "A smooth, wet, dark floor looks certain and may be wrong: what shines moves with the lamp as a surface would that "
    "lies elsewhere.",
    "The case's own pose is taken for right: a wrong one makes a wrong surface.",
    "Texture slides on a plane: poses and surface are told apart by relief only.",
    "Stages of drilling are mixed where they are not noticed: give it the frames of one stage.",
    "The model here is coarser than the file; structures did not move with the surface.",
)


def deviation_page(loaded: LoadedCase, found: SurfaceCorrection) -> bytes:
    """Make the page of a case's correction; it names neither case nor frames, which may be those of patients."""
    frame = loaded.frame
    colours = deviation_colours(found)
    mesh, fewer = reduced_mesh(found.mesh, MOST_VERTICES, colours)
    source = SourceFrame.of(frame.camera, frame.cam_from_model, mesh)
    away = mesh.vertices - source.pivot_model
    radius = float(np.abs(away).max())
    # about the pivot, at which the model is as large as in the frame
    pivot_cam = transform_points(frame.cam_from_model, source.pivot_model[None])
    width, height = frame.camera.size_wh
    (u, v), distance = frame.camera.project(pivot_cam)[0], float(pivot_cam[0, 2])
    most, picture = most_of(found), np.ascontiguousarray(to_uint8(frame.image)[..., ::-1])
    data = {
        "places": base64_text(np.rint(32767 * away / radius).astype("<i2").tobytes()),
        "faces": base64_text(mesh.faces.astype("<u2").tobytes()),
        "colours": base64_text(to_uint8(colours if fewer is None else fewer).tobytes()),
        "turned": np.round(frame.cam_from_model[:3, :3], 6).tolist(),
        "scale": frame.camera.fx * radius / distance / width,
        "middle": [(float(u) + 0.5) / width, (float(v) + 0.5) / height],
        "aspect": width / height,
        "most": f"{most:.1f}",
        "scaleColours": [to_uint8(np.array(colour)).tolist() for colour in (FARTHER, NOTHING, NEARER)],
        "frame": base64_text(webp(shrunk(picture, FRAME_PX), QUALITY)),
    }
    facts = [f"{found.frames} further frames over {found.angle_deg:.0f}°"]
    body = string.Template(asset("deviation.html")).substitute(
        header=page_header(kind="surface correction", name="Corrected surface", facts=facts, status=BADGE),
        most=f"{most:.1f}",
        floor=f"{found.floor_mm:.2f}",
        found=findings([f"{line[:1].upper()}{line[1:]}." for line in found.lines]),
        limits=findings(LIMITS),
        footer=page_footer(),
    )
    title = "Corrected surface · OneFrame"
    return html_page(title=title, body=body, data=data, scripts=("elements.js", "deviation.js"))
