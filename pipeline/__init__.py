"""From one aligned frame and a CT-derived surface to posed views with exact ground truth.

A folder is a stage, in the order in which data flows; its files are the nouns of the field:

========================  =====================================================================
``volume``                CT -> bone surface
``surface``               the triangle mesh
``video``                 microscope video -> frame
``camera``                K and distortion
``projection``            a mesh as a camera sees it: rasteriser, z-buffer, silhouette
``case``                  one frame, K, surface, pose, structures, landmarks
``alignment``             the pose of the frame: by hand, from landmarks, from the image itself
``colour``                what the frame saw, on the surface
``poses``                 new camera poses
``dataset``               views on disk, their tables, and the check of both
``packing``               a dataset as WebDataset shards
``reader``                a dataset or a pack, view by view as arrays
``evaluation``            how good it is
``charts``                figures as pictures
``sample``                the built-in case
``blender``               the same topics, where they need Blender
``commands``              what users call: the program ``oneframe`` and the scripts
========================  =====================================================================

Below them lie ``files`` and ``images``, :mod:`oneframe.transforms` (the conventions, as code), ``progress`` and
``errors``. Everything is pure (numpy and the standard library; ``cv2``, ``skimage`` and ``scipy`` only in ``video``,
``volume``, ``sample``, ``alignment``, ``evaluation``, ``reader``, ``packing.jpeg`` and ``dataset.check``) except
:mod:`oneframe.blender` and the commands that call it.
"""

from importlib import import_module

__version__ = "0.1.0"

_FROM = {
    "errors": ("InputError", "RunError"),
    "case.case_file": ("read_case",),
    "case.case_writer": ("write_case",),
    "blender.case.load_case": ("load_case",),
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
            return getattr(import_module(f".{module}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
