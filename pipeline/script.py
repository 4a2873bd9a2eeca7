"""What a script of one's own calls for a whole stage: the functions that need more than one room."""

import datetime
import os
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from . import __version__
from .alignment import align_case as alignment
from .blender.colour.export import export_coloured_surface
from .blender.dataset.job import Job
from .blender.dataset.run import run
from .camera.intrinsics_file import read_camera
from .case import new_case
from .case.case_file import Case, Structure, read_case
from .case.frame import read_frame
from .case.landmarks import read_landmarks
from .case.loaded_case import load_case
from .commands.render import own_command
from .dataset.description import input_files
from .dataset.option_arguments import merged_options, option_arguments
from .dataset.options import OPTIONS
from .dataset.run.run_folder import Shard
from .errors import InputError
from .files.keys import nearest_name
from .files.outputs import check_folder
from .surface.mesh import TriangleMesh
from .surface.structure_colour import structure_colour
from .volume.bone.bone import DEFAULT_HU, bone_voxels, check_threshold
from .volume.make_surface import SurfaceSettings, make_surface
from .volume.reading.volume_reader import read_volume


def surface_from_ct(ct: Path | str, *, threshold_hu: float = DEFAULT_HU) -> TriangleMesh:
    """The bone surface of a CT, smoothed and not simplified: ``vertices`` in mm (LPS) and ``faces``.

    Parameters
    ----------
    ct
        NIfTI, NRRD, or a folder of DICOM slices.
    threshold_hu
        Bone lies above it.
    """
    volume = read_volume(Path(ct))
    check_threshold(volume, threshold_hu)
    settings = SurfaceSettings(tolerance_mm=0)
    return make_surface(volume, threshold_hu, bone_voxels(volume, threshold_hu), None, settings).bone.mesh


def make_case(
    out: Path | str,
    *,
    surface: Path | str,
    frame: Path | str,
    camera: Path | str,
    structures: Mapping[str, Path | str] | None = None,
    mask: Path | str | None = None,
    overwrite: bool = False,
) -> Case:
    """Put a surface, a frame and K into a case folder; its pose is an initial guess.

    Parameters
    ----------
    out
        The folder; its case file is ``case.toml``.
    surface
        The folder of ``oneframe surface``, or a mesh file in mm.
    frame, camera
        An image, and a file with its K.
    structures
        Further structures: names -> mesh files in the frame of the surface.
    mask
        An image in which 0 shows no surface.
    overwrite
        Replace another frame or surface in that folder.
    """
    given = new_case.CaseInputs(
        surface=Path(surface),
        structures=tuple(
            Structure(name, Path(path), structure_colour(name)) for name, path in (structures or {}).items()
        ),
        units="mm",
        frame=read_frame(Path(frame)) if mask is None else read_frame(Path(frame)).with_mask(Path(mask)),
        camera=read_camera(Path(camera)),
        rescale_camera=False,
    )
    for _message in new_case.make_case(given, Path(out), overwrite=overwrite):
        pass
    return read_case(Path(out) / "case.toml")


def align_case(
    case: Case, landmarks: Path | str | None = None, *, refine: bool = False, click_sigma_px: float = 2.0
) -> alignment.AlignedCase:
    """Find the pose of a case; ``loaded.case`` of the result is the case with it, for ``write_case``.

    Parameters
    ----------
    case
        Its pose may be rough.
    landmarks
        A file of landmarks (CSV, JSON); those of the case if it is left out.
    refine
        Also refine the pose against the image.
    click_sigma_px
        Standard deviation of the click noise, along each image axis.
    """
    if landmarks is not None:
        case = replace(case, landmarks=read_landmarks(Path(landmarks), mm_per_unit=case.mm_per_unit))
    return alignment.align_case(
        case,
        click_sigma_px=click_sigma_px,
        refine=refine,
        tool=f"OneFrame {__version__}",
        date=datetime.date.today().isoformat(),
    )


def colour_surface(case: Case, out: Path | str, *, colour: str = "texture") -> list[str]:
    """Write the surface with the frame's colours as ``.glb``, ``.obj`` or ``.ply``; returns what to know about it.

    Parameters
    ----------
    colour
        ``"texture"``, or ``"vertex"`` (not for OBJ).
    """
    if colour not in ("texture", "vertex"):
        raise InputError(f"colour_surface: colour: expected 'texture' or 'vertex', found {colour!r}")
    return export_coloured_surface(load_case(case), Path(out), colour="vertex" if colour == "vertex" else "texture")


def render_dataset(case: Case, out: Path | str, *, workers: int = 0, **options: object) -> None:
    """Render a dataset of posed views, or go on where an earlier run of the same dataset was stopped.

    Parameters
    ----------
    case
        An aligned case, as its file has it: further processes read it again.
    out
        The dataset's folder.
    workers
        Number of processes, including this one; 0 for one per core.
    options
        Those of ``oneframe render`` with underscores, such as ``count=24`` or ``engine="raster"``; they go before
        those in the case file.
    """
    where, known, folder = "render_dataset", (*OPTIONS, "for_training"), Path(out)
    for name, value in options.items():
        if name not in known:
            raise InputError(f"{where}: unknown option {name!r}; {nearest_name(name, known)}")
        if isinstance(value, os.PathLike | np.generic):
            options[name] = os.fspath(value) if isinstance(value, os.PathLike) else value.item()
    chosen = merged_options(case.dataset, options, case.path, light=case.light, where=where)
    check_folder(folder, case.input_files() | input_files(case, chosen))
    arguments = [str(case.path), f"--out={folder}", *option_arguments(chosen)]
    command = [*own_command(), *arguments, "--worker"]
    run(Job(case, folder, chosen, Shard()), workers=workers, worker_command=command, stream=sys.stderr)
