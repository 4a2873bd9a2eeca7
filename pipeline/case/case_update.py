"""Save a case over its file: only what has changed is rewritten, so the author's comments and order stay."""

import os
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..files.content import read_content, write_files_atomically
from ..poses.pose_file import FORMER_POSE_KEY, POSE_KEY
from .case_file import Case, case_from_text
from .case_history import with_replaced
from .case_writer import case_output, case_text, encoded, write_case

if TYPE_CHECKING:
    from tomlkit import TOMLDocument
    from tomlkit.items import AoT

_BOM = "\ufeff"


def update_case(path: Path, case: Case) -> None:
    """Write a case to a file: a new one as :func:`.write_case`, an existing one value by value.

    Comments, order and form of an existing file stay, and so does every value that already means what the case says. A
    pose that is replaced goes into the file's history.

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
    saved = _existing(path, before)
    after = encoded(path, updated_text(path, before.decode(), case))
    if after != before:
        write_files_atomically({**with_replaced(path, saved, case), path: after})


def updated_text(path: Path, text: str, case: Case) -> str:
    """The text of the case file ``path``, changed to hold another case.

    What has changed shows where the file's own case and the other one are written alike, by :func:`.case_text`.

    Raises
    ------
    InputError
        The text is not that of a case file, or the case could not be read back.
    """
    import tomlkit

    target = case_text(path, case)
    wanted, newline = case_from_text(target, path), "\r\n" if "\r\n" in text else "\n"
    document = tomlkit.parse(text.removeprefix(_BOM) + ("" if text.endswith("\n") else newline))
    _adopt_conventions(document, path, wanted)
    old = case_from_text(document.as_string(), path)
    names = [each.name for each in old.structures]
    # their order means nothing, so the file's stays
    structures = sorted(case.structures, key=lambda each: [*names, each.name].index(each.name))
    new = case_text(path, replace(case, structures=tuple(structures)))
    _change(document, tomlkit.parse(case_text(path, old)), tomlkit.parse(new))
    changed = document.as_string()
    if newline == "\r\n":
        changed = changed.replace("\r\n", "\n").replace("\n", "\r\n")
    if differing_fields(case_from_text(changed, path), wanted):
        return target  # a form of TOML that cannot be changed like this: whole rather than wrong
    return text[: len(text) - len(text.removeprefix(_BOM))] + changed


def other_inputs(path: Path, case: Case) -> tuple[str, ...]:
    """Frame and surface of the case that a file holds, in words, as far as they are not those of ``case``.

    There are none if the file does not exist or is empty.

    Raises
    ------
    InputError
        The file is not a case file.
    """
    if not path.exists() or not path.stat().st_size:
        return ()
    saved = _existing(path, read_content(path, "a case file"))
    changed = differing_fields(saved, case)
    files = {"image": f"another frame ({saved.image.name})", "mesh": f"another surface ({saved.mesh.name})"}
    return tuple(words for name, words in files.items() if name in changed)


def check_replaced(path: Path, case: Case) -> None:
    """Check that a file which a case is to be written to holds no case of something else.

    Raises
    ------
    InputError
        It holds one of another frame or surface, or is not a case file.
    """
    if other := other_inputs(path, case):
        raise InputError(
            f"{path}: expected no file or a case of this frame and surface, found one of {' and '.join(other)}; "
            f"choose another name, or replace it with --overwrite"
        )


def _existing(path: Path, content: bytes) -> Case:
    try:
        return case_from_text(content, path)
    except InputError as error:
        raise InputError(f"{error}. Save the case under another name; this file is kept") from None


def differing_fields(one: Case, other: Case) -> tuple[str, ...]:
    """Names of the fields in which two cases differ, other than ``path`` and ``messages``.

    Files are compared by what they name. The order of structures does not count, since nothing depends on it.
    """
    meanings = [_meaning(case) for case in (one, other)]
    return tuple(name for name in meanings[0] if meanings[0][name] != meanings[1][name])


def _meaning(case: Case) -> dict[str, Any]:
    """What the fields say, wherever the case lies and whatever comes first."""
    meaning = {field.name: getattr(case, field.name) for field in fields(Case)}
    del meaning["path"], meaning["messages"]
    meaning |= {name: os.path.realpath(meaning[name]) for name in ("image", "mesh")}
    meaning["cam_from_mesh"] = case.cam_from_mesh.tolist()
    meaning["frames"] = [
        (os.path.realpath(each.image), each.camera, each.distortion, each.cam_from_mesh.tolist())
        for each in case.frames
    ]
    meaning["structures"] = {each.name: (os.path.realpath(each.mesh), each.colour) for each in case.structures}
    poses = case.dataset.get("poses")
    if isinstance(poses, str):
        meaning["dataset"] = {**case.dataset, "poses": os.path.realpath(case.path.parent / poses)}
    return meaning


def _adopt_conventions(document: "TOMLDocument", path: Path, wanted: Case) -> None:
    """Give the file the wanted units; and, if any pixel changes, the pixel origin in which it is written."""
    old = case_from_text(document.as_string(), path)
    if old.mm_per_unit != wanted.mm_per_unit:
        document["units"] = "mm" if wanted.mm_per_unit == 1 else "m"
    pixels = [{entry.name: entry.pixel for entry in case.landmarks} for case in (old, wanted)]
    camera: Any = document["camera"]
    if camera.get("pixel_origin", "center") != "center" and (old.camera != wanted.camera or pixels[0] != pixels[1]):
        camera["pixel_origin"] = "center"


def _change(target: Any, before: Any, after: Any) -> None:
    """Change a table of a file from one content to another, both in the writer's own form."""
    from tomlkit.items import AoT, Array, InlineTable, Table

    for key in before.keys() - after.keys():
        del target[_own_key(target, key)]
    for key, value in after.items():
        if key in before and _text(before[key]) == _text(value):
            continue
        own = _own_key(target, key)
        present = target.get(own)
        if isinstance(value, Table) and isinstance(present, Table):
            _change(present, before[key], value)
        elif isinstance(value, AoT) and isinstance(present, AoT):
            entries = _changed_entries(present, before[key], value)
            if entries is not present:
                target[own] = entries
        elif isinstance(value, Array) and isinstance(present, Array) and key in before:
            _change_array(target, own, before[key], value)
        else:
            if isinstance(present, InlineTable | Array) and isinstance(value, Table | AoT):
                # written anew as a section
                del target[own]
            target[own] = value


def _changed_entries(present: "AoT", before: "AoT", after: "AoT") -> "AoT":
    """The wanted entries of an array of tables; entries are the same by name, frames by image, else by place."""
    import tomlkit

    key = "name" if all("name" in entry for entry in before) else "image"
    by_name = {str(entry[key]): index for index, entry in enumerate(before)}
    sources = [by_name.get(str(entry[key])) for entry in after]
    if len(before) == len(after):  # renamed in place
        sources = [index if source is None and index not in sources else source for index, source in enumerate(sources)]
    for source, entry in zip(sources, after, strict=True):
        if source is not None:
            _change(present[source], before[source], entry)
    if sources == list(range(len(present))):
        return present
    entries = tomlkit.aot()
    for source, entry in zip(sources, after, strict=True):
        entries.append(entry if source is None else present[source])
    return entries


def _change_array(target: Any, key: Any, before: Any, after: Any) -> None:
    """Change single elements where the shape stays, so that comments between them do."""
    if len(target[key]) != len(after) or len(before) != len(after):
        target[key] = after
        return
    for index in range(len(after)):
        if _text(before[index]) == _text(after[index]):
            continue
        if isinstance(after[index], list) and isinstance(target[key][index], list):
            _change_array(target[key], index, before[index], after[index])
        else:
            target[key][index] = after[index]


def _own_key(target: Any, key: str) -> str:
    return FORMER_POSE_KEY if key == POSE_KEY and FORMER_POSE_KEY in target else key


def _text(item: Any) -> str:
    # of a container tomlkit gives truth values as Python's own
    return repr(item) if isinstance(item, bool) else str(item.as_string()).strip()
