"""Scenes to measure speed against accuracy in: a case at several mesh resolutions, poses of views, and photographs."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from oneframe.blender.dataset.job import Job, open_job
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import read_case
from oneframe.case.case_writer import write_case
from oneframe.case.loaded_case import LoadedCase, load_case
from oneframe.colour.reference_view import ReferenceView
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.run_folder import Shard
from oneframe.errors import InputError
from oneframe.files.outputs import made_folder
from oneframe.images.image_reader import read_image
from oneframe.registration.pose_list import read_photographs
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import inverse_rigid
from oneframe.volume.bone.simplification import simplified

LEAST_WIDTH = 640
"""Views are scaled down by a whole number while they keep this width, px: photographs are then averaged exactly."""
MOST_PHOTOGRAPHS = 6


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
        return self.poses[index] @ self.loaded.surface.mesh_from_model

    def written_poses(self) -> np.ndarray:
        """The poses in the unit of the case file, as ``--poses`` takes them."""
        poses = self.poses.copy()
        poses[:, :3, 3] /= self.loaded.case.mm_per_unit
        return poses

    def simplified_case(self, folder: Path, tolerance_px: float) -> tuple[Path, int]:
        """Write the case with a surface within a tolerance in pixels of the views; its path and number of faces."""
        distance = float(np.linalg.norm(self.source.view.cam_from_model[:3, 3]))
        mesh = simplified(self.loaded.surface.mesh, tolerance_px * distance / self.camera.fx)
        offset = self.loaded.surface.mesh_from_model[:3, 3]
        path = made_folder(folder / f"surface-{tolerance_px:g}.ply")
        write_ply(path, mesh.moved(offset).scaled(1 / self.loaded.case.mm_per_unit))
        case = folder / f"case-{tolerance_px:g}.toml"
        write_case(case, replace(self.loaded.case, path=case, mesh=path, structures=(), dataset={}))
        return case, len(mesh.faces)


def case_scene(name: str, path: Path, photographs: Path | None, *, views: int, seed: int) -> RenderScene:
    """The scene of a case file, with ``views`` planned views and at most :data:`MOST_PHOTOGRAPHS` photographs."""
    loaded = load_case(read_case(path))
    listed = read_photographs(photographs, loaded.case)[0] if photographs else []
    # evenly over the list, which usually goes around the surface
    listed = [listed[i] for i in np.unique(np.linspace(0, len(listed) - 1, MOST_PHOTOGRAPHS).astype(int)) if listed]
    factor = _factor(loaded.frame.camera)
    options = DatasetOptions(scale=1 / factor, count=views, seed=seed)
    with open_job(Job(loaded.case, path.parent / "unused", options, Shard())).renderer(threads=0) as renderer:
        camera, source = renderer.camera, renderer.reference
        planned = [renderer.plan(index).cam_from_model for index in range(views)]
    mesh_from_model = loaded.surface.mesh_from_model
    poses = np.array([*planned, *(photograph.cam_from_mesh @ mesh_from_model for photograph in listed)])
    pictures = tuple(_averaged(read_image(photograph.image)[0], camera, factor) for photograph in listed)
    in_mesh = poses @ inverse_rigid(mesh_from_model)
    return RenderScene(name, path, loaded, source, camera, factor, in_mesh, pictures)


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
