"""A case whose files all lie in its folder, under fixed names: copies that hold pixels and meshes, and nothing else.

Names of the given files, comments in their headers and metadata of images may name a patient: none is taken over.

The case goes last, and none of its files takes the place of another one: one with another content has that in its name
(:meth:`KeptFile.beside`). So whenever the work ends, the case names the files that it was written with.
"""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from ..errors import InputError
from ..files.content import content_named, is_content_named, names_in, read_content
from ..files.outputs import check_outputs, write_output
from ..surface.mesh_reader import read_mesh, stated_space
from ..surface.mesh_writer import encoded_ply
from .case_file import Case, case_from_text, read_case
from .case_writer import case_text, encoded
from .surface_folder import STRUCTURES, SURFACE, structure_file

CASE, FRAME, OVERLAY = "case.toml", "frame.png", "overlay.png"

_BARE_PLY = re.compile(
    rb"ply\nformat binary_little_endian 1\.0\n(?:comment SPACE=(?:LPS|RAS)\n)?"
    rb"(?:element (?:vertex|face) \d+\n|property (?:list uchar )?(?:float|uchar|int) \w+\n)+end_header\n"
)
"""The header that this program writes, without comments, which may name a patient or a texture."""


@dataclass(frozen=True)
class KeptFile:
    """A file of the folder."""

    path: Path
    data: bytes

    @property
    def is_there(self) -> bool:
        """Whether the file already holds this."""
        try:
            return self.path.stat().st_size == len(self.data) and self.path.read_bytes() == self.data
        except OSError:
            return False

    def beside(self, *, another: bool = True) -> "KeptFile":
        """The file under a name of its content, if it is there under that, or (``another``) its own name is taken."""
        named = replace(self, path=content_named(self.path, self.data))
        taken = another and self.path.exists() and not self.is_there
        return named if taken or named.is_there else self


def folder_outputs(folder: Path, structures: Iterable[str]) -> list[Path]:
    """The files of a new case, to be checked before any work; the structures are given by their names."""
    names: dict[str, str] = {}
    for name in structures:
        other = names.setdefault(structure_file(name).casefold(), name)
        if other != name:
            raise InputError(f"structures: expected names that differ in their letters, found {other!r} and {name!r}")
    return [folder / name for name in (SURFACE, *map(structure_file, names.values()), FRAME, OVERLAY, CASE)]


def kept_mesh(path: Path, target: Path) -> KeptFile:
    """A mesh as a file of the folder: byte by byte if it holds nothing else, or else as a new PLY in the same units."""
    data = read_content(path, "a mesh")
    if not _BARE_PLY.match(data):
        data = encoded_ply(read_mesh(path)[0], space=stated_space(path))
    return KeptFile(target, data)


def kept_case(case: Case) -> KeptFile:
    """The case file of a folder."""
    text = case_text(case.path, case)
    data = encoded(case.path, text)
    case_from_text(data, case.path)
    return KeptFile(case.path, data)


def keep_files(files: Sequence[KeptFile], inputs: Mapping[str, Path]) -> None:
    """Write files of a folder, in their order; those that are already there stay.

    ``inputs`` is what was read, by what it is.
    """
    fresh = [file for file in files if not file.is_there]
    check_outputs([file.path for file in fresh], inputs)
    for file in fresh:
        write_output(file.path, file.data)


def made_by_file(mesh: Path) -> Path:
    """The file that says how a surface was made from its CT: without names of files, which may name a patient."""
    return mesh.with_name(f"{mesh.stem}_made_by.json")


def remove_unnamed(folder: Path, replaced: Iterable[Path] = (), *, inputs: Iterable[Path] = ()) -> None:
    """Remove what only a case before, or a killed run, has left in the folder of a case that has just been written.

    Parameters
    ----------
    folder
        The case's.
    replaced
        The files of the case before; those stay whose names are not of this program's giving.
    inputs
        What stays in any case, as does what a case in the folder or in its queue names.
    """
    left = [folder / part / name for part in ("", STRUCTURES) for name in names_in(folder / part)]
    left = [path for path in left if is_content_named(path)]
    own = (folder / FRAME, folder / SURFACE)
    left += [path for path in replaced if path in own or path.parent == folder / STRUCTURES]
    named = set(map(os.path.realpath, inputs))
    try:
        for case in (*folder.glob("*.toml"), *folder.parent.glob(f"*/{CASE}")):
            named.update(map(os.path.realpath, read_case(case, posed=False).input_files().values()))
    except InputError:
        return  # who knows what it names
    for path in left:
        if os.path.realpath(path) not in named:
            with suppress(OSError):
                path.unlink()


def check_new(files: Iterable[KeptFile], instead: str) -> None:
    """Check that files of the folder are new or already hold this: else they would be those of another case."""
    for file in files:
        if file.path.exists() and not file.is_there:
            raise InputError(f"{file.path}: expected no such file or that of this case, found another one; {instead}")


def without_kept(outputs: Iterable[Path], inputs: Mapping[str, Path]) -> list[Path]:
    """The outputs that are no input: what already lies in the folder is compared with its new content later."""
    taken = {os.path.realpath(path) for path in inputs.values()}
    return [output for output in outputs if os.path.realpath(output) not in taken]
