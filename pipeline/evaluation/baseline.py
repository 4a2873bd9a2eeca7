"""The paper's method (Zhang & Noble 2024): the frame sampled at every vertex, whether it saw it or not, by PyVista.

PyVista runs as its users run it: off screen, RGB, in memory. It is optional: imported on use.
"""

from collections.abc import Callable
from importlib import import_module

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..errors import RunError
from ..images.pixel_values import sample_bilinear
from ..surface.mesh import TriangleMesh
from ..transforms import inverse_rigid, transform_points


def projected_colours(
    mesh: TriangleMesh, image: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray, *, clamped: bool
) -> np.ndarray:
    """``(V, 3)`` code values 0..1 of all vertices, bilinear, also of those that are occluded or face away.

    A vertex (X, Y, Z) is at the pixel (u, v) of the paper's projection, whatever lies in front of it:
    s (u, v, 1)^T = K [R|t] (X, Y, Z, 1)^T.

    Parameters
    ----------
    mesh
        The surface, model frame, mm.
    image
        ``(H, W, 3)`` code values 0..1 of the frame.
    camera, cam_from_model
        Intrinsics and pose (4x4, mm) of the frame.
    clamped
        Whether vertices outside the frame have the colour of the nearest pixel of its border; else they are black, as
        in the paper.

    Returns
    -------
    Colours; black behind the camera.
    """
    points_cam = transform_points(cam_from_model, mesh.vertices)
    behind = points_cam[:, 2] <= 0
    pixels = np.nan_to_num(camera.project(points_cam))
    clipped = np.clip(pixels, 0, np.array(camera.size_wh) - 1)
    # the border's pixels reach half a pixel further than their centres
    outside = (np.abs(pixels - clipped) > 0.5).any(axis=1) & (not clamped)
    return np.where((behind | outside)[:, None], 0, sample_bilinear(image, clipped)).astype(np.float32)


def pyvista_renderer(
    mesh: TriangleMesh,
    colours: np.ndarray,
    camera: PinholeCamera,
    *,
    samples: int,
    lit: bool,
    depth_range_mm: tuple[float, float],
) -> Callable[[np.ndarray], np.ndarray]:
    """Prepare a scene that PyVista renders with K.

    Parameters
    ----------
    mesh, colours
        Model frame, mm; ``(V, 3)`` uint8 colours of the vertices.
    samples
        Samples per pixel for multi-sampling; 1: none.
    lit
        Whether to use the light of the default scene, or to show the colours unchanged.
    depth_range_mm
        Clipping planes.

    Returns
    -------
    A function from ``cam_from_model`` (4x4) to the image, ``(H, W, 3)`` uint8.
    """
    try:
        pyvista = import_module("pyvista")
    except ImportError:
        raise RunError(
            "expected PyVista to compare with, it is not installed; run pip install pyvista and try again"
        ) from None
    plotter = pyvista.Plotter(off_screen=True, window_size=camera.size_wh, **({} if lit else {"lighting": "none"}))
    data = pyvista.PolyData.from_regular_faces(mesh.vertices.astype(np.float32), mesh.faces)
    data["rgb"] = colours
    plotter.add_mesh(data, scalars="rgb", rgb=True, lighting=lit)
    plotter.set_background("black")
    if samples > 1:
        plotter.enable_anti_aliasing("msaa", multi_samples=samples)
    else:
        plotter.disable_anti_aliasing()
    plotter.camera.view_angle = np.degrees(2 * np.arctan(camera.height / 2 / camera.fy))
    # VTK has one focal length: a transform after its projection widens the image, and with it the shift of the centre
    widening = camera.fx / camera.fy
    transform = import_module("vtkmodules.vtkCommonTransforms").vtkTransform()
    transform.Scale(widening, 1, 1)
    plotter.camera.SetUserTransform(transform)
    centre_x = -2 * (camera.cx - (camera.width - 1) / 2) / camera.width / widening
    plotter.camera.SetWindowCenter(centre_x, 2 * (camera.cy - (camera.height - 1) / 2) / camera.height)

    def render(cam_from_model: np.ndarray) -> np.ndarray:
        model_from_cam = inverse_rigid(cam_from_model)
        position, forward = model_from_cam[:3, 3], model_from_cam[:3, 2]
        plotter.camera.position = position
        plotter.camera.focal_point = position + np.mean(depth_range_mm) * forward
        plotter.camera.up = -model_from_cam[:3, 1]
        plotter.camera.clipping_range = depth_range_mm
        plotter.render()
        return plotter.screenshot(None, return_img=True)

    return render
