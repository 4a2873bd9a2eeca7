"""Scenes to measure speed against accuracy in: a case at several mesh resolutions, poses of views, and photographs."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.case_file import Case, read_case
from ...case.case_writer import write_case
from ...case.loaded_case import LoadedCase
from ...dataset.folder import Shard
from ...dataset.options import DatasetOptions
from ...errors import InputError
from ...evaluation.photographs import read_photographs
from ...evaluation.scenes.refinement_scenes import bloster_scenes
from ...files.content import write_bytes_atomically
from ...files.outputs import made_folder
from ...surface.mesh_writer import write_ply
from ...surface.simplification import simplified
from ...transforms import inverse_rigid
from ..bridge.image import read_image
from ..case.load_case import load_case
from ..colour.reference_view import ReferenceView
from ..dataset.job import Job, OpenJob, open_job

LEAST_WIDTH = 640
"""Views are scaled down by a whole number while they keep this width, px: photographs are then averaged exactly."""
MOST_PHOTOGRAPHS = 6
SOURCE_FRAME = 0
"""The frame of bloster that colours the surface."""


@dataclass(frozen=True)
class RenderScene:
    """A case with the poses of its views.

    Attributes
    ----------
    name
        Name of the scene.
    case
        The case file with the whole surface.
    loaded, source
        The case in memory, and its reference view.
    camera, factor
        Intrinsics of the views; the frame is this many times larger.
    poses
        ``(N, 4, 4)`` ``cam_from_mesh``, mm: planned views, then those of the photographs.
    photographs
        ``(H, W, 3)`` code values 0..1 of the last views, in their size.
    """

    name: str
    case: Path
    loaded: LoadedCase
    source: ReferenceView
    camera: PinholeCamera
    factor: int
    poses: np.ndarray
    photographs: tuple[np.ndarray, ...]

    @property
    def planned(self) -> int:
        """Number of views that are not those of photographs."""
        return len(self.poses) - len(self.photographs)

    def cam_from_model(self, index: int) -> np.ndarray:
        """Pose of a view (4x4, mm)."""
        return self.poses[index] @ self.loaded.mesh_from_model

    def options(self) -> DatasetOptions:
        """Options of the scene's views."""
        return DatasetOptions(scale=1 / self.factor)

    def opened(self) -> OpenJob:
        """A job of the scene's views, for its renderer alone."""
        return open_job(Job(self.loaded.case, self.case.parent / "unused", self.options(), Shard()))

    def simplified_case(self, folder: Path, tolerance_px: float) -> tuple[Path, int]:
        """Write the case with a surface within a tolerance in pixels of the views; its path and number of faces."""
        distance = float(np.linalg.norm(self.source.view.cam_from_model[:3, 3]))
        mesh = simplified(self.loaded.mesh, tolerance_px * distance / self.camera.fx)
        offset = self.loaded.mesh_from_model[:3, 3]
        path = made_folder(folder / f"surface-{tolerance_px:g}.ply")
        write_ply(path, mesh.moved(offset))
        case = folder / f"case-{tolerance_px:g}.toml"
        write_case(case, replace(self.loaded.case, path=case, mm_per_unit=1.0, mesh=path, structures=(), dataset={}))
        return case, len(mesh.faces)


def case_scene(name: str, path: Path, photographs: Path | None, *, views: int, seed: int) -> RenderScene:
    """The scene of a case file, with ``views`` planned views and at most :data:`MOST_PHOTOGRAPHS` photographs.

    Raises
    ------
    InputError
        The case or a photograph cannot be used.
    """
    loaded = load_case(read_case(path))
    listed = read_photographs(photographs, loaded) if photographs else []
    # evenly over the list, which usually goes around the surface
    listed = [listed[i] for i in np.unique(np.linspace(0, len(listed) - 1, MOST_PHOTOGRAPHS).astype(int)) if listed]
    factor = _factor(loaded.case.camera)
    options = DatasetOptions(scale=1 / factor, count=views, seed=seed)
    with open_job(Job(loaded.case, path.parent / "unused", options, Shard())).renderer(threads=0) as renderer:
        camera, source = renderer.camera, renderer.source
        planned = [renderer.plan(index).cam_from_model for index in range(views)]
    poses = np.array([*planned, *(photograph.cam_from_model for photograph in listed)])
    pictures = tuple(_averaged(read_image(photograph.path)[0], camera, factor) for photograph in listed)
    in_mesh = poses @ inverse_rigid(loaded.mesh_from_model)
    return RenderScene(name, path, loaded, source, camera, factor, in_mesh, pictures)


def write_bloster(data: Path, folder: Path) -> tuple[Path, Path]:
    """Write a case and a list of photographs from the folder of "bloster"; paths of both.

    Raises
    ------
    InputError
        A file is missing or holds something else.
    """
    scenes = bloster_scenes(data, coloured=False)
    made_folder(folder / "surface.ply")
    write_ply(folder / "surface.ply", scenes[0].mesh)
    images = [data / f"rgb/color_{number:02d}.jpg" for number in range(len(scenes))]
    first = scenes[SOURCE_FRAME]
    path = folder / "case.toml"
    write_case(
        path, Case(path, 1.0, images[SOURCE_FRAME], first.camera, None, folder / "surface.ply", first.cam_from_model)
    )
    others = [
        {"image": str(image.absolute()), "cam_from_mesh": scene.cam_from_model.tolist()}
        for number, (image, scene) in enumerate(zip(images, scenes, strict=True))
        if number != SOURCE_FRAME
    ]
    write_bytes_atomically(folder / "photographs.json", json.dumps(others).encode())
    return path, folder / "photographs.json"


def _factor(camera: PinholeCamera) -> int:
    """How many times views are smaller than the frame."""
    factors = range(1, max(camera.width // LEAST_WIDTH, 1) + 1)
    return max(factor for factor in factors if camera.width % factor == camera.height % factor == 0)


def _averaged(image: np.ndarray, camera: PinholeCamera, factor: int) -> np.ndarray:
    height, width = camera.shape_hw
    if image.shape[:2] != (height * factor, width * factor):
        raise InputError(
            f"photograph: expected {width * factor}x{height * factor} px as the frame has, "
            f"found {image.shape[1]}x{image.shape[0]}"
        )
    return image.reshape(height, factor, width, factor, 3).mean(axis=(1, 3), dtype=np.float32)
