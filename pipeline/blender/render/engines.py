"""Render one view of a surface to arrays: colour, depth and observed surface from the same rays.

Cycles' passes are read from memory before its render call returns. Eevee is built into Blender and writes its passes
only to files, so they are read from an uncompressed EXR in a temporary folder.
"""

import ctypes
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial

import bpy
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...colour.ray_tracer import RayTracer
from ...colour.shading import SurfaceColour
from ...errors import InputError
from ...evaluation.methods import Renderers
from ...files.temporary import temporary_folder, unwritable_temporary
from ...images.exr import ExrError, read_exr
from ...process.own_process import delayed_interrupts
from ...projection.rays import require_embree
from ...projection.rendered_view import Render, RenderedView
from ...surface.mesh import TriangleMesh
from ..bridge.image import render_path
from ..bridge.versions import set_multilayer_exr
from .material import OBSERVED_PASS, SOURCE_PASS
from .surface_scene import SurfaceScene

_TRIAL_ENDED = "trial render ended"
_BACKGROUND_MM = 1e9  # Blender's background has depth 1e10


def render_view(surface_scene: SurfaceScene, cam_from_model: np.ndarray) -> RenderedView:
    """Render the surface from a pose (4x4, mm)."""
    surface_scene.look_from(cam_from_model)
    if surface_scene.engine == "cycles":
        passes = _render_cycles(surface_scene.scene)
    else:
        passes = _render_to_file(surface_scene.scene)
    combined, depth = passes["Combined"], passes["Depth"][..., 0]
    # Eevee 4.5 gives the background the depth of the far clip plane
    depth = np.where((depth < _BACKGROUND_MM) & (combined[..., 3] > 0), depth, np.float32(0))
    # with several samples the flag is the mean over the pixel
    flag = np.where(depth > 0, passes[OBSERVED_PASS][..., 0], np.float32(0))
    rgb = combined[..., :3] if surface_scene.samples == 1 else _without_background(combined, depth)
    source = (flag > 0.5).astype(np.uint8)
    if SOURCE_PASS in passes:
        # at seams, several samples may be of several frames
        numbers = passes[SOURCE_PASS][..., 0] / (1.0 if surface_scene.samples == 1 else np.maximum(flag, 0.5))
        source *= np.clip(np.rint(numbers), 1, len(surface_scene.colours)).astype(np.uint8)
    return RenderedView(rgb, depth, source, flag > 1.5)


@contextmanager
def opened_engine(
    engine: str,
    mesh: TriangleMesh,
    camera: PinholeCamera,
    colours: Sequence[SurfaceColour],
    *,
    unseen: np.ndarray | None = None,
) -> Iterator[Render]:
    """What renders a surface with the best of several colours (none for geometry) and one sample a pixel.

    The other arguments are as of :class:`.SurfaceScene`.

    Raises
    ------
    InputError
        The engine cannot render it.
    """
    if engine == "raster":
        yield RayTracer(mesh, camera, *colours, unseen=unseen).render
        return
    with SurfaceScene(mesh, camera, *colours, unseen=unseen, engine=engine) as scene:
        yield partial(render_view, scene)


def _without_background(combined: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` the mean of the samples that hit the surface, black where the depth (0 for none) has none."""
    alpha = combined[..., 3:]
    shown = (depth[..., None] > 0) & (alpha > 0)
    return np.divide(combined[..., :3], alpha, out=np.zeros((*depth.shape, 3), np.float32), where=shown)


def _render_cycles(scene: bpy.types.Scene) -> dict[str, np.ndarray]:
    with _collected_passes() as results, delayed_interrupts():
        bpy.ops.render.render(scene=scene.name)
    if not results:
        raise RuntimeError("Cycles ended without a result")
    return results[-1]


@contextmanager
def _collected_passes() -> Iterator[list[dict[str, np.ndarray]]]:
    """Collect the passes of Cycles renders inside the block.

    Only the engine itself can read a render result. Cycles is an engine written in Python around a library, and Blender
    looks up its ``render_frame_finish`` at every call. So this block replaces that method by one that also reads the
    result.
    """
    import cycles

    engine, original = cycles.CyclesRender, cycles.CyclesRender.render_frame_finish
    results: list[dict[str, np.ndarray]] = []

    def finish_and_read(self: bpy.types.RenderEngine) -> None:
        # views of more than 8192 px are rendered in tiles, which are put together here
        original(self)
        result = self.get_result()
        results.append({p.name: _pass_array(p, result.resolution_y) for p in result.layers[0].passes})

    engine.render_frame_finish = finish_and_read
    try:
        yield results
    finally:
        engine.render_frame_finish = original


def _pass_array(render_pass: bpy.types.RenderPass, height: int) -> np.ndarray:
    values = np.empty(len(render_pass.rect) * render_pass.channels, np.float32)
    render_pass.rect.foreach_get(values)
    return values.reshape(height, -1, render_pass.channels)[::-1]


def _render_to_file(scene: bpy.types.Scene) -> dict[str, np.ndarray]:
    set_multilayer_exr(scene)
    with temporary_folder() as folder:
        path = folder / "view.exr"
        scene.render.filepath = render_path(path)
        try:
            with delayed_interrupts():
                bpy.ops.render.render(scene=scene.name, write_still=True)
            channels = read_exr(path)
        except (RuntimeError, OSError, ExrError) as error:
            raise unwritable_temporary(" ".join(str(error).split())) from error
    passes: dict[str, list[np.ndarray]] = {}
    for suffix in "RXVZGYBZA":
        for name, plane in channels.items():
            _, pass_name, channel = name.rsplit(".", 2)
            if channel == suffix and not (pass_name in passes and any(plane is p for p in passes[pass_name])):
                passes.setdefault(pass_name, []).append(plane)
    return {name: np.stack(planes, axis=-1) for name, planes in passes.items()}


def check_engine(engine: str) -> None:
    """Check that an engine works on this machine.

    Raises
    ------
    InputError
        The engine cannot render.
    """
    if engine == "raster":
        require_embree()
    if engine == "eevee" and not _has_opengl():
        raise InputError(
            f"--engine {engine}: expected an OpenGL context, Blender gets none on this machine; "
            "install Mesa's software OpenGL (libegl1, libgl1-mesa-dri) or a graphics driver, or use --engine cycles"
        )


@cache
def _has_opengl() -> bool:
    """Whether Blender gets an OpenGL context, by a trial render in a separate process.

    Without a context Blender does not report an error: the process ends at once, while it sets up OpenGL, by a
    segmentation fault (5.2, also in ``gpu.init()``) or an abort (4.5).
    """
    trial = (
        f"import bpy; scene = bpy.context.scene; scene.render.engine = 'BLENDER_WORKBENCH'; "
        f"scene.render.resolution_x = scene.render.resolution_y = 8; bpy.ops.render.render(); print({_TRIAL_ENDED!r})"
    )
    command = [sys.executable, "-c", trial]
    if not bpy.app.module:
        command = [bpy.app.binary_path, "-b", "--factory-startup", "--python-exit-code", "1", "--python-expr", trial]
    ended = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    return _TRIAL_ENDED in ended.stdout


def keep_freed_memory() -> None:
    """Let the C library reuse large buffers from view to view instead of returning them to the system.

    Otherwise every view's buffers are mapped, zeroed page by page and unmapped again, which takes a tenth of the time
    of a 1-sample view. Only glibc has this option; elsewhere nothing happens.
    """
    if sys.platform != "linux":
        return
    m_trim_threshold, m_mmap_threshold = -1, -3
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return
    mallopt(m_mmap_threshold, 1 << 30)
    mallopt(m_trim_threshold, 1 << 30)


RENDERERS = Renderers(check_engine, opened_engine, bpy.app.version_string)
"""For evaluations."""
