"""The engine ``eevee``: Blender's own rasteriser, which averages many samples at little cost, and needs OpenGL.

Eevee is built into Blender and writes its passes only to files, so they are read from an uncompressed EXR in a
temporary folder.
"""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import bpy
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...colour.shading import ColouredSurface
from ...errors import InputError
from ...files.temporary import temporary_folder, unwritable_temporary
from ...images.exr import ExrError, read_exr
from ...process.own_process import delayed_interrupts
from ...projection.rendered_view import Render
from ..bridge.image import render_path
from ..bridge.versions import EEVEE, set_multilayer_exr
from .engines import Engine
from .surface_scene import SurfaceScene

LARGEST_SIDE_PX = 16_384
"""Of a view: with more, OpenGL has no memory, and Eevee shows nothing without an error."""

_TRIAL_ENDED = "trial render ended"


@contextmanager
def _opened(surface: ColouredSurface, camera: PinholeCamera, samples: int, threads: int) -> Iterator[Render]:
    if max(camera.size_wh) > LARGEST_SIDE_PX:
        raise InputError(
            f"view: expected at most {LARGEST_SIDE_PX} px a side with engine eevee, found {camera.width}x"
            f"{camera.height}; use --engine cycles or --scale"
        )
    if surface.light is not None and surface.light.shadows:
        raise InputError(
            "--light shadows: Eevee knows them to a texel of a map only; use --engine cycles or --light lens"
        )
    with EeveeScene(surface, camera, samples=samples) as scene:
        scene.limit_threads(threads)
        yield scene.render


def _check() -> None:
    if not _has_opengl():
        raise InputError(
            "--engine eevee: expected an OpenGL context, Blender gets none on this machine; "
            "install Mesa's software OpenGL (libegl1, libgl1-mesa-dri) or a graphics driver, or use --engine cycles"
        )


# its depth buffer has 24 bits for the whole clip range: too few to tell what a frame saw
ENGINE = Engine(_opened, _check, reference="cycles")


class EeveeScene(SurfaceScene):
    """A scene that Eevee renders."""

    def _set_engine(self, filter_px: float) -> None:
        self.scene.render.engine = EEVEE
        self.scene.render.filter_size = filter_px
        self.scene.eevee.taa_render_samples = self._samples
        self.scene.eevee.use_raytracing = self.scene.eevee.use_shadows = False

    def _passes(self) -> dict[str, np.ndarray]:
        set_multilayer_exr(self.scene)
        with temporary_folder() as folder:
            path = folder / "view.exr"
            self.scene.render.filepath = render_path(path)
            try:
                with delayed_interrupts():
                    bpy.ops.render.render(scene=self.scene.name, write_still=True)
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
