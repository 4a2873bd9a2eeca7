"""Meshes of the structures in a label map, named by the anatomy."""

import itertools
import math
import re
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from unicodedata import category, normalize

import numpy as np

from ...surface.mesh import TriangleMesh
from ..volume import LabelMap
from .bone_surface import smoothed
from .isosurface import isosurface

BLUR_VOXELS = 0.7
"""Standard deviation of the Gaussian that turns the steps of a mask into a slope."""

_SMALL_VOXELS = 20_000
_SAME_VOLUME = 0.01
_MOST_TRIALS, _LOWEST_LEVEL = 10, 0.02
"""Structures of up to so many voxels get the volume of their mask, to that share, in up to so many trials."""

_ANATOMY = {
    r"chorda": "chorda_tympani",
    r"malleus": "malleus",
    r"incus": "incus",
    r"stapes": "stapes",
    r"ossic": "ossicles",
    r"facial (nerve|canal)|n(ervus)? facialis|fallopian|\bfn\b|\bcn ?(7|vii)\b": "facial_nerve",
    r"(ear|auditory|acoustic) (canal|meatus)|\beac\b": "eac",
    r"carotid|\bica\b": "ica",
    r"sigmoid|\bsinus\b(?! dura)": "sinus",
    r"labyrinth|inner ear|otic capsule": "bony_labyrinth",
}
"""Pattern in the name, words separated by spaces -> name; the first that matches counts."""

_INTERNAL_CANAL = re.compile(r"internal (ear|auditory|acoustic)|\biac\b")

_BONE = re.compile(r"^(cortical |temporal |compact )?bones?$", re.IGNORECASE)


def structure_name(label: str) -> str:
    """The name of a structure for a label's: ``"Facial Nerve (L)"`` -> ``"facial_nerve_left"``.

    Structures of the ear that are recognised get the names that colours and margins know; other names keep their words.
    """
    return anatomical_name(label) or _words(label).replace(" ", "_") or "structure"


def name_of_file(path: Path, taken: Collection[str]) -> str:
    """A name for a structure of which only the file is known, beside those that are taken."""
    names = itertools.chain([anatomical_name(path.stem)], (f"structure_{number}" for number in itertools.count(1)))
    return next(name for name in names if name and name not in taken)


def anatomical_name(text: str) -> str | None:
    """The structure of the ear that a text names, and nothing else of it; ``None`` if it names none.

    For names that nobody typed: the rest of a header's or of a file's may name the patient.
    """
    words = _words(text)
    sides = {
        side for side, pattern in (("left", r"\b(left|l)\b"), ("right", r"\b(right|r)\b")) if re.search(pattern, words)
    }
    if _INTERNAL_CANAL.search(words):
        known = "iac"
    else:
        known = next((name for pattern, name in _ANATOMY.items() if re.search(pattern, words)), "")
    return "_".join([known, *sides]) if known and len(sides) == 1 else known or None


def plain_text(text: str) -> str:
    """The letters of any script, digits and a few signs of a text; others become spaces."""
    kept = (c if c.isalnum() or c in "_.,()/+-" or category(c)[0] == "M" else " " for c in normalize("NFC", text))
    return " ".join("".join(kept).split())


def _words(text: str) -> str:
    # 3D Slicer and networks write words apart by spaces, underscores, dots or capitals
    return " ".join(re.split(r"[ _.,()/+-]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", plain_text(text)).lower())).strip()


def is_bone(label: str) -> bool:
    """Whether a label's name is that of the bone, of which the surface is made."""
    return _BONE.search(label) is not None


def without_bone(labels: LabelMap) -> LabelMap:
    """The map without the names of labels for bone."""
    return replace(labels, names={value: name for value, name in labels.names.items() if not is_bone(name)})


def structure_meshes(labels: LabelMap, *, progress: Callable[[float], None] | None = None) -> dict[str, TriangleMesh]:
    """One closed mesh per label that occurs and has a name, LPS mm, by the name of the structure.

    A mask is blurred, and its surface taken at the level 0.5. Of small structures it is taken at the level at which it
    encloses the volume of the mask: the blur would make thin ones, such as the chorda tympani, thinner or vanish.

    ``progress`` is called with the finished share, 0..1, after each structure; what it raises ends the work.
    """
    # not before there are structures: it takes long to import
    from scipy.ndimage import find_objects

    boxes = dict(enumerate(find_objects(labels.values), 1))
    # a cropped map keeps the names of labels that are gone
    wanted = {label: name for label, name in structure_names(labels).items() if boxes.get(label)}
    meshes = {}
    for count, (label, name) in enumerate(wanted.items()):
        meshes[name] = _mesh(labels, label, boxes[label])
        if progress is not None:
            progress((count + 1) / len(wanted))
    return meshes


def structure_names(labels: LabelMap) -> dict[int, str]:
    """Names by label, the label's number behind a name that occurs twice."""
    names: dict[int, str] = {}
    for label, given in labels.names.items():
        name = structure_name(given)
        names[label] = f"{name}_{label}" if name in names.values() else name
    return names


def _mesh(labels: LabelMap, label: int, box: tuple[slice, ...]) -> TriangleMesh:
    from scipy.ndimage import gaussian_filter

    mask = labels.values[box] == label
    reach = math.ceil(3 * BLUR_VOXELS)
    margin = reach + 1
    # around it, also beyond the volume's border, is air
    field = gaussian_filter(np.pad(mask.astype(np.float32), margin), BLUR_VOXELS, mode="constant", radius=reach)
    depth, height, width = field.shape
    grid = labels.grid.shifted(np.array([each.start - margin for each in box[::-1]]), (width, height, depth))
    voxels = int(np.count_nonzero(mask))
    lowest, highest = _LOWEST_LEVEL, 0.999 * float(field.max())
    level = min(0.5, highest)
    for _ in range(_MOST_TRIALS):
        mesh = smoothed(isosurface(field, level, grid)).mesh
        ratio = _volume_mm3(mesh) / (voxels * grid.voxel_mm3)
        if voxels > _SMALL_VOXELS or abs(ratio - 1) < _SAME_VOLUME:
            break
        lowest, highest = (level, highest) if ratio > 1 else (lowest, level)
        level = (lowest + highest) / 2
    return mesh


def _volume_mm3(mesh: TriangleMesh) -> float:
    """The volume of a closed mesh, by the divergence theorem."""
    # from a corner: far from the origin the sum would lose digits
    return float(np.einsum("ij,ij->", mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[0], mesh.face_cross)) / 6
