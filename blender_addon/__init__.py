"""The Blender add-on: align one frame to a surface in the viewport, know how well, colour it, render a dataset.

A topic is a folder is a panel of the sidebar, in the order of the work: ``setup``, ``view``, ``move``, ``landmarks``,
``refine``, ``colour``, ``dataset``. ``state`` holds the properties and their way to and from the pipeline's data,
``ui`` what all topics draw and click with. Operators are thin: they gather from the scene, call one function of the
pipeline and report.

The extension carries the pipeline inside this package; in a checkout it lies beside it, and ``.pipeline`` names the
same modules.
"""

import sys
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from pathlib import Path
from types import ModuleType

_HERE = Path(__file__).resolve().parent


class _PipelineBeside(MetaPathFinder, Loader):
    """Finds ``.pipeline`` as the package beside this one: the same modules, never copies of their classes."""

    def __init__(self) -> None:
        self._own_specs: dict[str, ModuleSpec | None] = {}

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        is_pipeline = name == f"{__name__}.pipeline" or name.startswith(f"{__name__}.pipeline.")
        return spec_from_loader(name, self) if is_pipeline else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(spec.name.removeprefix(f"{__name__}."))
        self._own_specs[spec.name] = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        # it is executed already; the import system has only put this alias's spec in the place of its own
        if module.__spec__ is not None:
            module.__spec__ = self._own_specs.pop(module.__spec__.name)


_PIPELINE_BESIDE = _PipelineBeside()


def _find_pipeline() -> None:
    if (_HERE / "pipeline").is_dir() or _PIPELINE_BESIDE in sys.meta_path:
        return
    sys.path.insert(0, str(_HERE.parent))
    sys.meta_path.insert(0, _PIPELINE_BESIDE)


_find_pipeline()

_MODULES = tuple(
    import_module(f".{name}", __name__)
    for name in (
        "state.properties",
        "setup.operators",
        "setup.panel",
        "view.operators",
        "view.overlay",
        "view.swipe_gizmo",
        "landmarks.loupe",
        "view.second_view",
        "view.panel",
        "move.operators",
        "move.panel",
        "move.gizmo",
        "refine.operator",
        "refine.panel",
        "dataset.background_job",
        "colour.operators",
        "colour.panel",
        "dataset.pose_preview",
        "dataset.operators",
        "dataset.panel",
        "landmarks.solve",
        "landmarks.gestures",
        "landmarks.operators",
        "landmarks.tool",
        "landmarks.drawing",
        "landmarks.panel",
    )
)


def register() -> None:
    """Called by Blender when the add-on is enabled."""
    _find_pipeline()
    for module in _MODULES:
        module.register()


def unregister() -> None:
    """Called by Blender when the add-on is disabled; leaves nothing behind."""
    for module in reversed(_MODULES):
        module.unregister()
    if _PIPELINE_BESIDE in sys.meta_path:
        sys.meta_path.remove(_PIPELINE_BESIDE)
        sys.path.remove(str(_HERE.parent))
