"""From one aligned frame and a CT-derived surface to posed views with exact ground truth.

A folder is a stage of the data flow: ``docs/developing.md`` has the map. Here is what scripts of one's own import.
"""

from importlib import import_module

__version__ = "0.1.0"

_FROM = {
    "errors": ("InputError", "RunError"),
    "case.case_file": ("read_case",),
    "case.case_writer": ("write_case",),
    "case.loaded_case": ("load_case",),
    "script": ("surface_from_ct", "make_case", "align_case", "colour_surface", "render_dataset"),
    "dataset.check.check_dataset": ("check_dataset",),
    "packing.pack": ("pack_dataset",),
    "reader": ("open_dataset",),
}
"""Modules -> what is public of them."""
__all__ = [name for names in _FROM.values() for name in names]


def __getattr__(name: str) -> object:
    """Import what is public when it is first asked for: each room needs its own libraries."""
    for module, names in _FROM.items():
        if name in names:
            # reads what is no plain PNG
            import_module(".blender", __name__)
            return getattr(import_module(f".{module}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
