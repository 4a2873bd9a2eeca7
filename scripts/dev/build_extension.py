"""Build the Blender extension: one zip per platform, for "Install from Disk".

python scripts/dev/build_extension.py [--platform all|current|NAME...] [--out dist] [--blender PROGRAM]
"""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# the version and the exceptions come from the package, also where it is not installed
sys.path.insert(0, str(ROOT / "scripts"))

import argparse
import fnmatch
import hashlib
import importlib.util
import os
import platform
import re
import shutil
import subprocess
import tempfile
import tomllib
import zipfile
from collections.abc import Iterable, Iterator, Sequence

from oneframe import __version__
from oneframe.errors import InputError, RunError
from oneframe.files.outputs import check_outputs

WHEEL_TAGS = {
    "linux-x64": ("manylinux2014_x86_64", "manylinux_2_28_x86_64"),
    "macos-arm64": ("macosx_14_0_arm64",),
    "windows-x64": ("win_amd64",),
}
"""Blender's platform names -> pip's; without windows-arm64 and macos-x64, for which OpenCV or numba has no wheel."""
SAMPLE_CACHE = ROOT / "build" / "sample"
SAMPLE_SOURCES = ("sample", "blender/sample", "volume", "case")
MAKE_SAMPLE = """
import sys
sys.path.insert(0, sys.argv[1])
from pathlib import Path
from oneframe.blender.sample.sample_case import write_sample_case
from oneframe.sample.temporal_bone import sample_surface
for _ in write_sample_case(Path(sys.argv[2]), sample_surface(), held_out=False):
    pass
"""
WHEEL_CACHE = ROOT / "build" / "wheels"
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
"""From Blender 4.5's to that of Linux distributions; wheels of the stable ABI (abi3) for the first one serve all."""
SCRIPTS = ("oneframe.py", "render_dataset.py")
"""Scripts for a Blender without a window, of which the add-on runs the second."""
VERSION_LINE = 'version = "0.0.0"'
"""The line of the manifest that the build fills in."""


def parse_arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="build_extension.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--platform",
        nargs="+",
        choices=("all", "current", *WHEEL_TAGS),
        default=["all"],
        help="for which computers (default: all)",
    )
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=ROOT / "dist", help="folder of the zips (default: dist)"
    )
    parser.add_argument(
        "--blender", metavar="PROGRAM", help="build with this Blender (default: with the bpy module of this Python)"
    )
    return parser.parse_args(argv)


def platforms(names: Sequence[str]) -> list[str]:
    """Blender's names of the platforms that ``--platform`` asks for."""
    if "all" in names:
        return list(WHEEL_TAGS)
    if "current" in names and this_platform() not in WHEEL_TAGS:
        raise RunError(
            f"--platform current: OpenCV or numba has no wheel for {this_platform()}; name some of "
            f"{', '.join(WHEEL_TAGS)}"
        )
    return list(dict.fromkeys(this_platform() if name == "current" else name for name in names))


def this_platform() -> str:
    """Blender's name of this platform, e.g. ``linux-x64``."""
    system, machine = platform.system().lower(), platform.machine().lower()
    return f"{ {'darwin': 'macos'}.get(system, system) }-{ {'x86_64': 'x64', 'amd64': 'x64'}.get(machine, machine) }"


def build(names: Sequence[str], out: Path, *, blender: str | None = None) -> Iterator[Path]:
    """Build and validate the extension.

    Parameters
    ----------
    names
        Blender's names of the platforms, keys of :data:`WHEEL_TAGS`.
    out
        Folder of the zips, made if it does not exist; zips of the same version are replaced.
    blender
        A Blender program; ``None`` uses the command-line tool that the bpy module brings.

    Yields
    ------
    Each zip once Blender has found it valid.
    """
    tool, tags = _extension_tool(blender)
    wheels = [path for name in names for path in wheels_for(name)]
    with tempfile.TemporaryDirectory(prefix="oneframe-extension-") as folder:
        staged, built = Path(folder, "oneframe"), Path(folder, "built")
        stage(staged, names, wheels)
        built.mkdir()
        _run([*tool, "build", "--source-dir", staged, "--output-dir", built, "--split-platforms", *tags])
        out.mkdir(parents=True, exist_ok=True)
        check_outputs([out / path.name for path in built.glob("*.zip")], {})
        for path in sorted(built.glob("*.zip")):
            _run([*tool, "validate", path])
            partial = out / f".partial-{path.name}"
            shutil.copyfile(path, partial)
            os.replace(partial, out / path.name)
            yield out / path.name


def stage(folder: Path, names: Sequence[str], wheels: Sequence[Path]) -> None:
    """Copy the extension's files to ``folder`` as installed: the add-on, the package inside it, scripts, wheels."""
    no_caches = shutil.ignore_patterns("__pycache__")
    # the extension has no permission to use a network, and code that trains runs outside Blender
    for_blender = shutil.ignore_patterns("__pycache__", "cluster", "reader")
    shutil.copytree(ROOT / "blender_addon", folder, ignore=no_caches)
    shutil.copytree(ROOT / "pipeline", folder / "pipeline", ignore=for_blender)
    for part in ("scripts", "wheels"):
        (folder / part).mkdir()
    for name in SCRIPTS:
        shutil.copyfile(ROOT / "scripts" / name, folder / "scripts" / name)
    for path in wheels:
        shutil.copyfile(path, folder / "wheels" / path.name)
    shutil.copytree(sample_case(), folder / "sample")
    shutil.copyfile(ROOT / "LICENSE", folder / "LICENSE")
    manifest = folder / "blender_manifest.toml"
    manifest.write_text(_filled_in(manifest.read_text("utf-8"), names, wheels), "utf-8")


def _filled_in(manifest: str, names: Sequence[str], wheels: Sequence[Path]) -> str:
    if manifest.count(VERSION_LINE) != 1:
        raise InputError(f"blender_manifest.toml: expected one line {VERSION_LINE!r}, which the build fills in")
    lines = [
        f'version = "{__version__}"',
        f"platforms = {_toml_list(names)}",
        # one of pure Python serves all platforms
        f"wheels = {_toml_list(dict.fromkeys(f'./wheels/{path.name}' for path in wheels))}",
    ]
    return manifest.replace(VERSION_LINE, "\n".join(lines))


def _toml_list(texts: Iterable[str]) -> str:
    return "[" + ", ".join(f'"{text}"' for text in texts) + "]"


def sample_case() -> Path:
    """The folder of the sample case for the extension; made once, and again when the code that makes it has changed."""
    sources = sorted(path for part in SAMPLE_SOURCES for path in (ROOT / "pipeline" / part).rglob("*.py"))
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
    folder = SAMPLE_CACHE / digest[:12]
    if not (folder / "case.toml").is_file():
        print("making the sample case for the extension (once)", flush=True)
        SAMPLE_CACHE.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=SAMPLE_CACHE) as partial:
            command = [sys.executable, "-c", MAKE_SAMPLE, str(ROOT / "scripts"), str(Path(partial, "sample"))]
            ended = subprocess.run(command, capture_output=True, text=True, check=False)
            if ended.returncode != 0:
                raise RunError(
                    f"the sample case cannot be made here: {_last_line(ended.stderr)}; run `make setup` first"
                )
            shutil.rmtree(folder, ignore_errors=True)
            os.replace(Path(partial, "sample"), folder)
    return folder


def wheels_for(name: str) -> list[Path]:
    """The wheels of the extension for a platform: OpenCV, SimpleITK, PyAV, numba, scikit-image, SciPy and others.

    Parameters
    ----------
    name
        Blender's name of the platform.
    """
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
    stable = [text for text in needed if text.startswith(("opencv-", "SimpleITK", "av="))]
    # all that scikit-image's marching cubes need
    stable.append("lazy-loader>=0.4")
    by_python = ("isal", "pyfqmr", "PyYAML", "scikit-image")
    of_each_python = [text for text in needed if text.startswith(by_python)]
    # the newest for all of these, and for numpy 1.26 and 2.x
    of_each_python += ["scipy==1.17.*", "numba==0.68.*", "llvmlite==0.50.*"]
    oldest = wheels([*stable, *of_each_python], name, PYTHONS[0])
    others = [wheels(of_each_python, name, python) for python in PYTHONS[1:]]
    return [*oldest[: len(stable)], *map(joined, zip(oldest[len(stable) :], *others, strict=True))]


def joined(wheels: Sequence[Path]) -> Path:
    """One wheel of those for several Pythons, whose modules have names of their own and whose libraries are the same.

    Blender installs an extension only for the Pythons that all of its wheels name; this one names none.
    """
    package, version, *_, platforms = wheels[0].name.split("-")
    path = wheels[0].with_name(f"{package}-{version}-py3-none-{platforms}")
    if path.exists() and path.stat().st_mtime > max(each.stat().st_mtime for each in wheels):
        return path
    files: dict[str, bytes] = {}
    records: dict[str, str] = {}
    for each in wheels:
        with zipfile.ZipFile(each) as archive:
            files |= {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}
        record = next(name for name in files if name.endswith(".dist-info/RECORD"))
        records |= {line.partition(",")[0]: line for line in files[record].decode().splitlines()}
    files[record] = "".join(line + "\n" for line in records.values()).encode()
    # another build may be reading it
    partial = path.with_name(f".partial-{os.getpid()}-{path.name}")
    with zipfile.ZipFile(partial, "w") as archive:
        for name, data in files.items():
            # no date, so that the same wheels make the same one; in half the time of the usual level, 1 % larger
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED, compresslevel=4)
    os.replace(partial, path)
    return path


def wheels(requirements: Sequence[str], name: str, python: str) -> list[Path]:
    """The wheels of packages for a platform, from ``build/wheels``; pip downloads at once what is missing there.

    Parameters
    ----------
    requirements
        Each ``package==version``, or ``package>=version`` for the newest.
    name
        Blender's name of the platform.
    python
        The Python for which they are, or the oldest one.
    """
    folder = WHEEL_CACHE / name
    if missing := [each for each in requirements if not _newest(folder, _patterns(each, python))]:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".partial-", dir=WHEEL_CACHE) as partial:
            _download(missing, name, python, partial)
            for path in Path(partial).glob("*.whl"):
                os.replace(path, folder / path.name)
    found = []
    for each in requirements:
        if (newest := _newest(folder, patterns := _patterns(each, python))) is None:
            raise RunError(f"wheel of {each} for {name}: pip downloaded another file than {' or '.join(patterns)}")
        found.append(newest)
    return found


def _patterns(requirement: str, python: str) -> list[str]:
    """The names that a package's wheel may have."""
    package, _, version = requirement.partition("==")
    package, tag = re.split(r"[<>=~!]", package)[0].replace("-", "_"), f"cp{python.replace('.', '')}"
    ends = f"{tag}-{tag}-*.whl", "*-abi3-*.whl", "*-none-any.whl"
    return [f"{package}-{version or '*'}-{end}".lower() for end in ends]


def _newest(folder: Path, patterns: Sequence[str]) -> Path | None:
    # pip writes names in either case
    names = {path.name.lower(): path for path in folder.glob("*.whl")}
    found = [names[name] for pattern in patterns for name in fnmatch.filter(names, pattern)]
    return max(found, key=lambda path: path.stat().st_mtime, default=None)


def _download(requirements: Sequence[str], name: str, python: str, folder: str) -> None:
    tags = " ".join(f"--platform {tag}" for tag in WHEEL_TAGS[name])
    target = f"{tags} --python-version {python} --implementation cp --abi abi3 --abi cp{python.replace('.', '')}"
    options = f"--quiet --disable-pip-version-check --no-input --retries 1 --no-deps --only-binary :all: {target}"
    command = [sys.executable, "-m", "pip", "download", *options.split(), "--dest", folder, *requirements]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        offline = any(words in ended.stderr for words in ("establish a new connection", "timed out", "name resolution"))
        cause = "no connection to the package index" if offline else _last_line(ended.stderr)
        raise RunError(
            f"wheels of {', '.join(requirements)} for {name}: pip could not download them: {cause}; connect this "
            f"computer to the network, or put the wheels into {WHEEL_CACHE / name}"
        )


def _extension_tool(blender: str | None) -> tuple[list[str], list[str]]:
    """The command that builds and validates extensions, and the options that give ``build`` the tags Blender knows."""
    if blender:
        if not (program := shutil.which(blender)):
            raise InputError(f"--blender: expected a program, found {blender!r}")
        return [program, "--factory-startup", "--command", "extension"], []
    module = importlib.util.find_spec("bpy")
    for folder in (module.submodule_search_locations or ()) if module else ():
        for path in Path(folder).glob("*/scripts/addons_core/*/cli/blender_ext.py"):
            tags = path.parents[3] / "modules" / "_bpy_internal" / "extensions" / "tags.py"
            return [sys.executable, str(path)], ["--valid-tags", str(tags)]
    raise InputError("expected a Blender to build with, this Python has no bpy module; name one with --blender PROGRAM")


def _run(command: Sequence[str | Path]) -> None:
    ended = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        raise InputError(f"Blender refuses the extension: {_last_line(ended.stderr) or _last_line(ended.stdout)}")


def _last_line(text: str) -> str:
    """The last line that mentions an error, else the last that is not empty."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return ([line for line in lines if "error" in line.lower()] or lines or [""])[-1]


def main(argv: Sequence[str]) -> int:
    arguments = parse_arguments(argv)
    try:
        for path in build(platforms(arguments.platform), arguments.out, blender=arguments.blender):
            print(f"{path}  {path.stat().st_size / 1e6:.1f} MB", flush=True)
    except (InputError, RunError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2 if isinstance(error, InputError) else 3
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
