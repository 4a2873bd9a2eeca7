"""The stages of ``oneframe surface``: inputs, bone, what is removed, surface, files."""

import json
import platform
import re
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import numpy as np

from ... import __version__
from ...case.surface_folder import RECORD, STRUCTURES, SURFACE, focus_table, structure_file, write_meshes
from ...files.outputs import check_outputs, check_own_folder, write_output, writing
from ...progress import ShareProgress
from ...surface.structure_colour import structure_colour
from ...volume.bone.bone import DEFAULT_HU, bone_voxels, check_threshold, otsu_threshold
from ...volume.bone.isosurface import RemovedField
from ...volume.bone.structures import structure_names, without_bone
from ...volume.drill.drill_plan import DrillPlan, check_margins, check_strokes, read_drill_plan, unprotected
from ...volume.drill.virtual_drill import clearances, violations
from ...volume.make_surface import MadeSurface, SurfaceSettings, make_surface
from ...volume.reading.label_map import read_labels
from ...volume.reading.volume_reader import read_volume
from ...volume.volume import Volume

if TYPE_CHECKING:
    from . import Arguments

MOST_REMOVED = 0.5
"""Share of the bone; above it, something else than what was removed was given by mistake."""


@dataclass
class _Work:
    """What the stages have found so far, and where they say so. Mutable: each stage adds to the record."""

    output: TextIO
    record: dict[str, object] = field(default_factory=dict)
    start: float = field(default_factory=time.monotonic)
    stage: str = ""
    bar: ShareProgress | None = None

    def say(self, text: str) -> None:
        """Report a finished stage, with the time since the start."""
        self.end_bar()
        self.output.write(f"{time.monotonic() - self.start:6.1f} s  {text}\n")

    def report(self, stage: str, share: float) -> None:
        """Show the progress of a stage."""
        if self.stage != stage:
            self.end_bar()
            self.stage = stage
            self.bar = None if share == 1 else ShareProgress(stage, stream=self.output)
        if self.bar is not None:
            self.bar.reach(share)

    def end_bar(self) -> None:
        """End the bar of a stage, if it has one."""
        if self.bar is not None:
            self.bar.close()
            self.bar = None


def write_surface(arguments: "Arguments", out: Path, output: TextIO) -> None:
    """Make the surface that the arguments of ``oneframe surface`` describe, and report every stage."""
    work = _Work(output)
    inputs = {name: path for name in ("volume", "drill", "remove", "labels") if (path := getattr(arguments, name))}
    check_own_folder(out, "|".join(map(re.escape, (SURFACE, RECORD, STRUCTURES))), inputs)
    check_outputs(_outputs(out, ()), inputs)
    try:
        _make(arguments, work, out, inputs)
    finally:
        work.end_bar()


def _make(arguments: "Arguments", work: _Work, out: Path, inputs: Mapping[str, Path]) -> None:
    # small, and quick to refuse
    plan = None if arguments.drill is None else read_drill_plan(arguments.drill)
    crop = None if arguments.crop is None else np.array(arguments.crop).reshape(2, 3)
    volume = read_volume(arguments.volume, series=arguments.series, crop_mm=crop)
    size, spacing = volume.grid.size, [round(float(step), 4) for step in volume.grid.spacing_mm]
    work.record["frame"] = "LPS, mm"
    work.record["volume"] = {
        "size": list(size), "spacing_mm": spacing, "mesh_from_index": volume.grid.mesh_from_index.tolist()
    }  # fmt: skip
    work.say(f"volume: {_by(size)} voxels of {_by(spacing)} mm")
    if plan is not None and arguments.drill is not None:
        for message in check_strokes(plan, volume.grid, arguments.drill.name):
            work.say(message)
        for message in unprotected(plan.margins_mm):
            work.say(f"warning: {message}")
    labels = None
    if arguments.labels is not None:
        labels = without_bone(read_labels(arguments.labels, volume))
        check_outputs(_outputs(out, structure_names(labels).values()), inputs)
    if plan is not None:
        check_margins(plan.margins_mm, () if labels is None else structure_names(labels).values())
    # read before the long work, which what they hold could make vain
    taken = None if arguments.remove is None else read_labels(arguments.remove, volume)

    level, how = _threshold(arguments, volume)
    work.record |= {"threshold_hu": level, "threshold_by": how}
    solid = bone_voxels(volume, level, smallest_mm3=arguments.islands, hole_mm3=arguments.holes)
    bone_mm3 = float(np.count_nonzero(solid)) * volume.grid.voxel_mm3
    work.record["bone"] = {
        "volume_mm3": round(bone_mm3, 1), "islands_mm3": arguments.islands, "holes_mm3": arguments.holes
    }  # fmt: skip
    work.say(f"bone above {level:g} HU ({how}): {bone_mm3 / 1000:.1f} cm³")

    settings = SurfaceSettings(plan, taken, arguments.tolerance, arguments.smooth)
    made = make_surface(volume, level, solid, labels, settings, report=work.report)
    _report_removed(work, made)
    if plan is not None and made.removed is not None:
        _report_clearances(work, made, made.removed, volume, plan)
    _write_meshes(work, out, made)
    _write_record(work, out)


def _threshold(arguments: "Arguments", volume: Volume) -> tuple[float, str]:
    if arguments.threshold == "otsu":
        return otsu_threshold(volume), "otsu"
    level, how = (DEFAULT_HU, "default") if arguments.threshold is None else (float(arguments.threshold), "given")
    check_threshold(volume, level)
    return level, how


def _report_removed(work: _Work, made: MadeSurface) -> None:
    if made.removed is None:
        return
    work.record["removed"] = {"by": list(made.removed_by), "volume_mm3": round(made.removed_mm3, 1)}
    work.say(f"removed by {' and '.join(made.removed_by)}: {made.removed_mm3:.0f} mm³ of bone")
    if made.removed_share > MOST_REMOVED:
        work.say(f"warning: that is {made.removed_share:.0%} of the bone; check what was given as removed")


def _report_clearances(work: _Work, made: MadeSurface, removed: RemovedField, volume: Volume, plan: DrillPlan) -> None:
    """Record how near the drill came to the structures, and say where it came too near."""
    found = clearances(made.bone, removed, volume.grid, made.structures, plan.margins_mm)
    work.record["drill"] = {
        "strokes": len(plan.strokes), "margins_mm": dict(plan.margins_mm),
        "clearances": [
            {
                "structure": each.structure, "margin_mm": each.margin_mm, "smallest_mm": round(each.smallest_mm, 3),
                "at": [round(float(value), 2) for value in each.at],
            }
            for each in found
        ],
    }  # fmt: skip
    for each in found[:1]:
        work.say(f"nearest to the drill: {each.structure}, {each.smallest_mm:.2f} mm")
    for sentence in violations(found):
        work.say(f"warning: {sentence}")


def _outputs(out: Path, structures: Iterable[str]) -> list[Path]:
    return [out / name for name in (SURFACE, RECORD, *map(structure_file, structures))]


def _write_meshes(work: _Work, out: Path, made: MadeSurface) -> None:
    mesh, finish = made.bone.mesh, made.finish
    work.record["surface"] = {
        "file": SURFACE, "vertices": len(mesh.vertices), "faces": len(mesh.faces),
        "drilled_vertices": int(made.bone.drilled.sum()),
        "smoothing_steps": finish.smoothing_steps, "tolerance_mm": finish.tolerance_mm,
    }  # fmt: skip
    if finish.focus is not None:
        work.record["focus"] = focus_table(finish.focus)
    # without its report, the folder is none until all of it is new
    with writing(out / RECORD):
        (out / RECORD).unlink(missing_ok=True)
    write_meshes(out, mesh, made.structures)
    work.say(f"{len(mesh.faces):,} faces: {out / SURFACE}")
    work.record["structures"] = {
        name: {"file": structure_file(name), "faces": len(each.faces), "colour": list(structure_colour(name))}
        for name, each in made.structures.items()
    }
    if made.structures:
        work.say(f"{len(made.structures)} structures: {out / STRUCTURES}")


def _write_record(work: _Work, out: Path) -> None:
    """Write the report, the last of all files: a folder with one is whole."""
    work.record["versions"] = {
        "oneframe": __version__, "python": platform.python_version(), "numpy": np.__version__,
        "SimpleITK": version("SimpleITK"),
    }  # fmt: skip
    text = json.dumps(work.record, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    write_output(out / RECORD, text.encode())
    work.say(f"report: {out / RECORD}")


def _by(values: Sequence[float]) -> str:
    return " x ".join(f"{value:g}" for value in values)
