"""Cases of bloster coloured by one frame and by three, to be evaluated on the photographs that colour nothing.

Every second photograph is a candidate for the colour, the others judge. Two candidates are chosen as
``oneframe register --colour-frames 2`` chooses them.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from oneframe.case.case_file import read_case
from oneframe.case.frame import UnreadFrame, load_posed_frame
from oneframe.case.loaded_case import load_case
from oneframe.images.pixel_values import to_uint8
from oneframe.registration.pose_list import read_photographs
from oneframe.registration.register_case import register_case
from oneframe.registration.register_frames import CaseRegistrar, FurtherFrame
from oneframe.transforms import inverse_rigid

from ..alignment.registration_trials import small
from ..published import CaseFiles, bloster_cases, written_case

FRAMES = 2
VARIANTS = (
    # name, poses of the frames that colour besides the source, poses of the photographs that judge
    ("one frame", "", "published"),
    ("three frames", "published", "published"),
    ("one frame, registered poses", "", "registered"),
    ("three frames, registered poses", "registered", "registered"),
    ("three registered frames, published photographs", "registered", "published"),
)
METHODS = ("projective-raster", "projective-fill-raster")
"""Each variant is evaluated with each of these keys of ``oneframe evaluate``: a further option of colouring is a key,
or a variant."""


def colour_cases(folder: Path, out: Path, *, judges: int | None = None) -> list[CaseFiles]:
    """Write a case and a list of photographs for each of :data:`VARIANTS`, from bloster's first source."""
    case = read_case(bloster_cases(folder, out / "published")[0][0])
    loaded = load_case(case)
    listed, _ = read_photographs(case.path.with_suffix(".json"), case)
    candidates, judging = listed[::2], listed[1::2][:judges]
    (out / "candidates").mkdir()
    for number, each in enumerate(candidates):
        (out / "candidates" / f"{number:02d}{each.image.suffix}").symlink_to(each.image)
    chosen = register_case(
        loaded, out / "candidates", out / "registered", colour_frames=FRAMES, progress=lambda _: None
    ).sources
    numbers = [int(frame.image.stem[len("frame_") :][:6]) for frame in chosen]
    frames: dict[str, Sequence[UnreadFrame]] = {"": (), "registered": chosen}
    frames["published"] = [
        replace(frame, cam_from_mesh=candidates[number].cam_from_mesh)
        for frame, number in zip(chosen, numbers, strict=True)
    ]
    registrar, found = CaseRegistrar(loaded), []
    for each in judging:
        frame = small(load_posed_frame(each, np.eye(4), name="bloster"))
        registered = registrar.register(FurtherFrame(each.image.name, 0, to_uint8(frame.image), frame.valid))
        if registered.cam_from_model is not None:
            pose = registered.cam_from_model @ inverse_rigid(loaded.surface.mesh_from_model)
            found.append(replace(each, cam_from_mesh=pose))
    photographs = {"published": judging, "registered": found}
    return [
        written_case(
            replace(case, path=out / f"{name}.toml", frames=tuple(frames[colouring])),
            [(each.image, each.cam_from_mesh) for each in photographs[judged]],
        )
        for name, colouring, judged in VARIANTS
    ]
