"""What a case has and the scene no property for: further frames, lamp, the surface's name, options of other programs.

It is the text of the case as it was read or written. Its units are the scene's, and its lengths are in them.
"""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import bpy

from ..pipeline.blender.bridge.data_blocks import absolute_path
from ..pipeline.case.case_file import Case, case_from_text
from ..pipeline.case.case_writer import case_text
from ..pipeline.case.frame import UnreadFrame
from ..pipeline.dataset.options import PATHS
from ..pipeline.light.lens_light import LensLight

UNNAMED = Path("/case.toml")
"""Where the case lies while the scene has no file: the names of its files are relative to that folder."""


def case_of_file(scene: bpy.types.Scene) -> Case | None:
    """The case of the scene's file, or what of it still holds for another frame or surface; ``None`` for none."""
    text = scene.oneframe.case_text
    return _parsed(f'units = "{scene.oneframe.units}"\n{text}', _place(scene)) if text else None


def further_frames(scene: bpy.types.Scene) -> tuple[UnreadFrame, ...]:
    """The case's frames beside the one that is shown, as its file has them."""
    known = case_of_file(scene)
    return () if known is None else known.frames


def lamp_of(scene: bpy.types.Scene) -> LensLight | None:
    """The lamp at the lens of the scene's case; ``None`` if none is known."""
    known = case_of_file(scene)
    return None if known is None else known.light


def _place(scene: bpy.types.Scene) -> Path:
    path = scene.oneframe.case_path
    return absolute_path(path) if path else UNNAMED


@lru_cache(maxsize=4)
def _parsed(text: str, path: Path) -> Case:
    return case_from_text(text, path)


def remember_file(scene: bpy.types.Scene, case: Case) -> None:
    """Tie the scene to the file of a case, as it was read or written: Save Case writes there."""
    scene.oneframe.case_path = str(case.path.resolve())
    keep_case_of_file(scene, case)


def keep_case_of_file(scene: bpy.types.Scene, case: Case) -> None:
    """Keep a case, in the scene's units, as that of the scene's file, see :func:`case_of_file`."""
    # the first line has the units
    scene.oneframe.case_text = case_text(_place(scene), case).partition("\n")[2]


def part_from_case(scene: bpy.types.Scene, *, surface: bool = False) -> None:
    """End the tie to the case's file and dataset: another frame or surface comes, and must not get into them."""
    settings, known = scene.oneframe, case_of_file(scene)
    if settings.case_path:
        settings.property_unset("case_path")
        settings.property_unset("dataset_out")
    if known is None:
        return
    dataset = dict(known.dataset)
    for key in PATHS & dataset.keys():
        # which was relative to that file
        dataset[key] = str(known.path.parent / str(dataset[key]))
    name = None if surface else known.object_name
    keep_case_of_file(scene, replace(known, path=UNNAMED, dataset=dataset, frames=(), object_name=name))
