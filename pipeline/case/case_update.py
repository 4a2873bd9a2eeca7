"""Save a case over its file: only what has changed is rewritten, so the author's comments and order stay."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.content import read_content, write_bytes_atomically
from ..files.tables import parsed_toml
from ..poses.pose_file import FORMER_POSE_KEY, POSE_KEY
from .case_file import Case, Structure, case_from_text
from .case_writer import case_output, case_text, encoded, toml_value, write_case
from .landmarks import Landmark
from .toml_document import TomlDocument

_FIELDS = {
    "frame": ("image",),
    "camera": ("camera", "distortion"),
    "surface": ("mesh", "object_name"),
    "pose": ("cam_from_mesh",),
    "alignment": ("alignment",),
    "landmarks": ("landmarks",),
    "structures": ("structures",),
    "dataset": ("dataset",),
    "cluster": ("cluster",),
}
"""Table of the file -> the fields of a case that it holds."""

_BOM = "\ufeff"


def update_case(path: Path, case: Case) -> None:
    """Write a case to a file: a new one as :func:`.write_case`, an existing one value by value.

    Comments, order and form of an existing file stay, and so does every value that already means what the case says.

    Raises
    ------
    InputError
        As :func:`.write_case`; or the existing file is not a case file, which is never replaced.
    OSError
        The file cannot be written.
    """
    case_output(path)
    if not path.exists():
        write_case(path, case)
        return
    before = read_content(path, "a case file")
    try:
        case_from_text(before, path)
    except InputError as error:
        raise InputError(f"{error}. Save the case under another name; this file is kept") from None
    after = encoded(path, updated_text(path, before.decode(), case))
    if after != before:
        write_bytes_atomically(path, after)


def updated_text(path: Path, text: str, case: Case) -> str:
    """The text of the case file ``path``, changed to hold another case.

    Raises
    ------
    InputError
        The text is not that of a case file, or the case could not be read back.
    """
    target = case_text(path, case)
    new, wanted = TomlDocument(target), case_from_text(target, path)
    document = TomlDocument(text.removeprefix(_BOM))
    if not document.text.endswith("\n"):
        document = TomlDocument(document.text + document.newline)
    document = _with_conventions(path, document, new, wanted)
    old = case_from_text(document.text, path)
    changed = differing_fields(old, wanted)
    for section, names in _FIELDS.items():
        if not set(names) & set(changed):
            continue
        if document.value_text((section,)) is not None:
            # an inline table or list: written anew as a section
            document = _with_section(document.without((section,)), new, section)
        elif section in ("landmarks", "structures"):
            document = _with_entries(document, new, section, getattr(old, section), getattr(wanted, section))
        else:
            document = _with_table(document, new, section, old, wanted)
    if differing_fields(case_from_text(document.text, path), wanted):
        return target  # a form of TOML that this module cannot change: whole rather than wrong
    return text[: len(text) - len(text.removeprefix(_BOM))] + document.text


def differing_fields(one: Case, other: Case) -> tuple[str, ...]:
    """Names of the fields in which two cases differ, other than ``path`` and ``messages``.

    Files are compared by what they name. The order of structures does not count, since nothing depends on it.
    """
    names = [field.name for field in fields(Case) if field.name not in ("path", "messages")]
    return tuple(name for name in names if not _EQUAL.get(name, _same)(one, other, name))


def _with_conventions(path: Path, document: TomlDocument, new: TomlDocument, wanted: Case) -> TomlDocument:
    """The document with the wanted units; and, if any pixel changes, with the pixel origin in which it is written."""
    if case_from_text(document.text, path).mm_per_unit != wanted.mm_per_unit:
        document = document.with_value(("units",), new.value_text(("units",)) or "")
    old = case_from_text(document.text, path)
    pixels = [{entry.name: entry.pixel for entry in case.landmarks} for case in (old, wanted)]
    origin = parsed_toml(document.text, path.name)["camera"].get("pixel_origin", "center")
    if origin != "center" and (old.camera != wanted.camera or pixels[0] != pixels[1]):
        if document.value_text(("camera",)) is None:
            return document.with_value(("camera", "pixel_origin"), '"center"')
        return _with_section(document.without(("camera",)), new, "camera")
    return document


def _with_section(document: TomlDocument, new: TomlDocument, section: str) -> TomlDocument:
    """The document with all values of a section of the new one."""
    for statement in new.statements:
        if statement.path[0] == section and statement.value is not None:
            document = document.with_value(statement.path, new.text[slice(*statement.value)])
    return document


def _with_table(document: TomlDocument, new: TomlDocument, section: str, old: Case, wanted: Case) -> TomlDocument:
    before, after = (_leaves(case, section) for case in (old, wanted))
    for key in before.keys() - after.keys():
        document = document.without((section, key))
    if section in ("alignment", "dataset", "cluster") and not after:
        return document.without((section,))
    for key, value in after.items():
        if key in before and _equal_values(before[key], value):
            continue
        name = FORMER_POSE_KEY if document.has((section, FORMER_POSE_KEY)) and key == POSE_KEY else key
        document = document.with_value((section, name), new.value_text((section, key)) or toml_value(value))
    return document


def _leaves(case: Case, section: str) -> dict[str, Any]:
    """The keys of a table and what they mean."""
    match section:
        case "frame":
            return {"image": os.path.realpath(case.image)}
        case "surface":
            named = {} if case.object_name is None else {"name": case.object_name}
            return {"mesh": os.path.realpath(case.mesh), **named}
        case "pose":
            return {POSE_KEY: case.cam_from_mesh.tolist()}
        case "camera":
            camera = {"size": case.camera.size_wh, "K": case.camera.k.tolist()}
            return camera if case.distortion is None else camera | {"distortion": case.distortion}
        case "alignment":
            return dict(case.alignment)
    return _options(case)


def _with_entries(
    document: TomlDocument,
    new: TomlDocument,
    section: str,
    old: Sequence[Landmark | Structure],
    wanted: Sequence[Landmark | Structure],
) -> TomlDocument:
    """The document with the wanted entries of an array of tables; entries are the same by name, else by place."""
    by_name = {entry.name: index for index, entry in enumerate(old)}
    sources = [by_name.get(entry.name) for entry in wanted]
    if len(old) == len(wanted):  # renamed in place
        taken = set(sources)
        sources = [index if source is None and index not in taken else source for index, source in enumerate(sources)]
    for index in sorted(set(range(len(old))) - set(sources), reverse=True):
        document = document.without((section, index))
    kept = sorted(source for source in sources if source is not None)
    places = []
    for number, source in enumerate(sources):
        before = {} if source is None else _entry_leaves(old[source])
        after = _entry_leaves(wanted[number])
        place = len(kept) + sum(each is None for each in sources[:number]) if source is None else kept.index(source)
        places.append(place)
        for key in before.keys() - after.keys():
            document = document.without((section, place, key))
        for key, value in after.items():
            if key not in before or before[key] != value:
                if key == "enabled" and key not in before and value:
                    continue  # the default
                text = new.value_text((section, number, key)) or toml_value(value)
                document = document.with_value((section, place, key), text)
    return document if section == "structures" else document.with_order(section, places)


def _entry_leaves(entry: Landmark | Structure) -> dict[str, Any]:
    if isinstance(entry, Structure):
        return {"name": entry.name, "mesh": os.path.realpath(entry.mesh), "color": entry.colour}
    leaves: dict[str, Any] = {"name": entry.name}
    if entry.point is not None:
        leaves["surface"] = entry.point
    if entry.pixel is not None:
        leaves["pixel"] = entry.pixel
    return leaves | {"enabled": entry.enabled}


def _by_name(structures: Sequence[Structure]) -> dict[str, Any]:
    return {structure.name: _entry_leaves(structure) for structure in structures}


def _options(case: Case) -> dict[str, Any]:
    """The options of a case, with the absolute path of the poses' file."""
    poses = case.dataset.get("poses")
    return (
        {**case.dataset, "poses": os.path.realpath(case.path.parent / poses)}
        if isinstance(poses, str)
        else case.dataset
    )


def _same(one: Case, other: Case, name: str) -> bool:
    return getattr(one, name) == getattr(other, name)


def _same_file(one: Case, other: Case, name: str) -> bool:
    return os.path.realpath(getattr(one, name)) == os.path.realpath(getattr(other, name))


def _equal_values(one: Any, other: Any) -> bool:
    """Equality with the type of truth values: 1 is no true."""
    return type(one) is type(other) and one == other


_EQUAL: Mapping[str, Callable[[Case, Case, str], bool]] = {
    "cam_from_mesh": lambda one, other, name: np.array_equal(one.cam_from_mesh, other.cam_from_mesh),
    "image": _same_file,
    "mesh": _same_file,
    "structures": lambda one, other, name: _by_name(one.structures) == _by_name(other.structures),
    "dataset": lambda one, other, name: _options(one) == _options(other),
}
