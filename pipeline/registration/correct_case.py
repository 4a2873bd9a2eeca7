"""Correct the surface of a case by accepted frames, and write it with its map, page and case beside nothing else."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from .. import __version__
from ..case.case_file import Case
from ..case.case_history import history_path
from ..case.case_update import check_replaced
from ..case.case_writer import relative_name, write_case
from ..case.loaded_case import LoadedCase
from ..colour.lens_shading import lens_shading_of
from ..errors import InputError
from ..files.content import write_files_atomically
from ..files.outputs import check_outputs, check_own_folder, made_folder, writing
from ..images.legend import Write
from ..images.png import encode_png
from ..surface.mesh_reader import stated_space
from ..surface.mesh_writer import encoded_ply
from ..surface_correction import CASE, MAP, NOT_FOR_SURGERY, PAGE, SURFACE
from ..surface_correction.correct_surface import (
    LONGER_SIDE_PX,
    MOST_FRAMES,
    SurfaceChanged,
    SurfaceCorrection,
    correct_surface,
)
from ..surface_correction.deviation_map import deviation_map
from .accepted_frames import AcceptedFrames, small_frames

NAMES = "|".join(map(re.escape, (SURFACE, MAP, PAGE, CASE, history_path(Path(CASE)).name)))
"""Regular expression of the files that the folder may hold."""
NO_LAMP = (
    "the case has no lamp at the lens: what its light does as it moves is taken for a wrong surface; find it with "
    "oneframe light first"
)

Page = Callable[[LoadedCase, SurfaceCorrection], bytes]
"""Makes the page; its room stands above this one."""


@dataclass(frozen=True)
class CaseCorrection:
    """A case, accepted frames of it, and the folder for what comes of them."""

    loaded: LoadedCase
    accepted: AcceptedFrames
    out: Path

    def check(self) -> None:
        """Check before the work that the folder may be written.

        Raises
        ------
        InputError
            It holds an input, something else, or the case of another frame or surface.
        RunError
            It cannot be written.
        """
        inputs = self.loaded.case.input_files() | self.accepted.files
        check_own_folder(self.out, NAMES, inputs)
        check_outputs([self.out / name for name in (SURFACE, MAP, PAGE, CASE)], inputs)
        check_replaced(self.out / CASE, self._corrected)

    @property
    def notes(self) -> tuple[str, ...]:
        """What to know before."""
        changed = self.accepted.changed
        later = f"{changed} later frames, in which the surface has changed, are left out"
        return (*(() if self.loaded.case.light is not None else (NO_LAMP,)), *((later,) if changed else ()))

    def correct(self, progress: Callable[[float], None] = lambda share: None) -> SurfaceCorrection:
        """Correct the surface, in any thread; nothing is written.

        Raises
        ------
        InputError
            The images cannot be read, or as :func:`.correct_surface`.
        """
        light = None if self.loaded.case.light is None else lens_shading_of(self.loaded)
        accepted, later = self.accepted, ""
        while True:
            frames = small_frames(self.loaded, accepted, MOST_FRAMES, LONGER_SIDE_PX)
            try:
                found = correct_surface(self.loaded.surface.mesh, frames, light, progress)
            except SurfaceChanged as change:
                accepted = accepted.until(frames[change.since - 1].cam_from_model)
                count = len(self.accepted.poses) - len(accepted.poses)
                later = f"the surface has changed after frame {max(accepted.poses)}, so {count} later ones are left out"
            except InputError as error:
                raise InputError(f"{self.loaded.case.path.name}: {later and f'{later}; '}{error}") from None
            else:
                return replace(found, later=later)

    def write(self, found: SurfaceCorrection, write: Write, page: Page) -> tuple[str, ...]:
        """Write the files, each whole or not at all, the case last; returns where they are, in words.

        Raises
        ------
        RunError
            They cannot be written.
        """
        case, out, surface = self.loaded.case, self.out, self.loaded.surface
        mesh = found.mesh.moved(surface.mesh_from_model[:3, 3]).scaled(1 / case.mm_per_unit)
        values = {"deviation": found.deviation_mm, "std_mm": found.std_mm, "confirmed": found.confirmed}
        files = {
            out / SURFACE: encoded_ply(mesh, space=stated_space(case.mesh), values=values),
            out / MAP: encode_png(deviation_map(self.loaded, found, write)),
            out / PAGE: page(self.loaded, found),
        }
        comment = (
            f"{SURFACE} is {case.mesh.name} corrected by registered frames, {NOT_FOR_SURGERY} "
            f"(OneFrame {__version__})\n{'; '.join(found.lines)}\n"
            f"the surface as it was: {relative_name(case.mesh, out)}"
        )
        with writing(made_folder(out / SURFACE)):
            write_files_atomically(files)
            write_case(out / CASE, self._corrected, comment=comment)
        return f"the corrected surface and its case: {out / CASE}", f"where it differs: {out / PAGE}"

    @property
    def _corrected(self) -> Case:
        return replace(self.loaded.case, mesh=self.out / SURFACE)
