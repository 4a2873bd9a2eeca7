"""The Blender add-on: align a frame to a surface, assess the alignment, colour the surface, render a dataset.

Each topic has a folder and a panel in the sidebar, in the order of the work: ``volume``, ``setup`` with ``mask``,
``video`` and ``case_queue``, ``view``, ``move``, ``landmarks``, ``refine``, ``frames``, ``colour``, ``dataset``.
``state`` holds the properties and converts them to and from the pipeline's types; ``ui`` holds the drawing and input
code that the topics share.
Operators are thin: they read the scene, call one function of the pipeline and report.

The extension contains the pipeline inside this package. In a checkout it lies next to it, and ``.pipeline`` is an alias
for the package ``oneframe``, which scripts and tests import: the same modules.
"""

import sys
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from pathlib import Path
from types import ModuleType

from .class_registration import registration

_HERE = Path(__file__).resolve().parent


class _CheckoutPipeline(MetaPathFinder, Loader):
    """In a checkout, imports ``.pipeline`` as the package ``oneframe``: the same modules, not copies of them."""

    def __init__(self) -> None:
        self._own_specs: dict[str, ModuleSpec | None] = {}

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        is_pipeline = name == f"{__name__}.pipeline" or name.startswith(f"{__name__}.pipeline.")
        return spec_from_loader(name, self) if is_pipeline else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module("oneframe" + spec.name.removeprefix(f"{__name__}.pipeline"))
        self._own_specs[spec.name] = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        # executed already; but the import system has replaced the module's own spec by that of the alias
        if module.__spec__ is not None:
            module.__spec__ = self._own_specs.pop(module.__spec__.name)


_CHECKOUT_PIPELINE = _CheckoutPipeline()


def _find_pipeline() -> None:
    if (_HERE / "pipeline").is_dir() or _CHECKOUT_PIPELINE in sys.meta_path:
        return
    # here the folder beside this one is found under the package's name
    scripts = str(_HERE.parent / "scripts")
    sys.path.insert(0, scripts)
    import_module("oneframe")
    sys.path.remove(scripts)
    sys.meta_path.insert(0, _CHECKOUT_PIPELINE)


_find_pipeline()

_REGISTRATION = registration(__name__)


def register() -> None:
    """Called by Blender when the add-on is enabled."""
    _find_pipeline()
    _REGISTRATION.register()


def unregister() -> None:
    """Called by Blender when the add-on is disabled; leaves nothing behind."""
    _REGISTRATION.unregister()
    if _CHECKOUT_PIPELINE in sys.meta_path:
        sys.meta_path.remove(_CHECKOUT_PIPELINE)
