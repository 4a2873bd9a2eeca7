"""Wheel, source distribution and extension: what is in them, and that the installed program works."""

import ast
import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

from oneframe import __version__
from scripts.dev import build_extension

pytestmark = pytest.mark.long

ROOT = Path(__file__).resolve().parents[1]
FILES = [*(ROOT / "pipeline").rglob("*.py"), *(ROOT / "pipeline" / "report" / "assets").iterdir()]
"""Of the package, which is installed as ``oneframe``."""
INSTALLED = {Path("oneframe", path.relative_to(ROOT / "pipeline")).as_posix() for path in FILES}
ABOUT = f"oneframe-{__version__}.dist-info"


def build(source: Path, out: Path, *kinds: str) -> None:
    """With the setuptools that is installed: needs no network."""
    command = [sys.executable, "-m", "build", "--no-isolation", *kinds, "--outdir", str(out), str(source)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    """A folder with the wheel and the source distribution, built from a copy of the checkout."""
    folder = tmp_path_factory.mktemp("packages")
    wanted = [*(path.name for path in ROOT.glob("*.*")), "LICENSE", "Makefile"]
    wanted += ["blender_addon", "docs", "pipeline", "scripts", "tests"]
    ignored = shutil.ignore_patterns("__pycache__")
    for path in (ROOT / name for name in wanted if not name.startswith(".") and not name.endswith(".egg-info")):
        if path.is_dir():
            shutil.copytree(path, folder / "source" / path.name, ignore=ignored)
        elif path.is_file():
            (folder / "source").mkdir(exist_ok=True)
            shutil.copy(path, folder / "source" / path.name)
    build(folder / "source", folder / "dist")
    return folder / "dist"


def names_in(wheel: Path) -> dict[str, int]:
    with zipfile.ZipFile(wheel) as archive:
        return {file.filename: file.CRC for file in archive.infolist()}


@pytest.fixture(scope="module")
def wheel(built) -> Path:
    (path,) = built.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """The folder of the programs in a fresh environment with this wheel and the packages that the tests need."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False, symlinks=os.name != "nt")
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    install = ["--python", str(programs / "python"), "install", "--quiet", "--no-deps", "--no-index", str(wheel)]
    subprocess.run([sys.executable, "-m", "pip", "--disable-pip-version-check", *install], check=True)
    paths = sysconfig.get_paths(vars={"base": str(folder), "platbase": str(folder)})
    # only the folder: .pth files in it, which would bring the checkout, are not followed
    outer = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    Path(paths["purelib"], "outer.pth").write_text("\n".join(outer) + "\n")
    return programs


@pytest.fixture
def run_installed(installed, run_command, tmp_path, monkeypatch):
    """Runs a program of that environment, away from the checkout."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    return lambda name, *arguments: run_command([str(installed / name), *map(str, arguments)])


def test_the_wheel_holds_the_package_and_its_licence_and_nothing_else(wheel):
    names = set(names_in(wheel))
    assert {name for name in names if not name.startswith(ABOUT)} == INSTALLED
    assert f"{ABOUT}/licenses/LICENSE" in names
    with zipfile.ZipFile(wheel) as archive:
        assert archive.read(f"{ABOUT}/licenses/LICENSE") == (ROOT / "LICENSE").read_bytes()
        about = Parser().parsestr(archive.read(f"{ABOUT}/METADATA").decode())
    assert (about["Name"], about["Version"]) == ("oneframe", __version__)
    assert about["License-Expression"] == "GPL-3.0-or-later"
    for key in ("Author", "Keywords", "Classifier", "Project-URL", "Summary"):
        assert about[key], key


def test_the_source_distribution_builds_the_same_wheel(built, wheel, tmp_path):
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        packed.extractall(tmp_path, filter="data")
    source = tmp_path / f"oneframe-{__version__}"
    for name in ("CHANGELOG.md", "LICENSE", "Makefile", "README.md", "blender_addon/blender_manifest.toml"):
        assert (source / name).read_bytes() == (ROOT / name).read_bytes()
    for folder in ("scripts", "tests", "blender_addon"):
        own = {path.relative_to(ROOT) for path in (ROOT / folder).rglob("*.py")}
        assert own == {path.relative_to(source) for path in (source / folder).rglob("*.py")}
    build(source, tmp_path / "again", "--wheel")
    (again,) = (tmp_path / "again").glob("*.whl")
    assert names_in(again) == names_in(wheel)


def test_the_installed_program_is_the_one_of_the_wheel(run_installed, tmp_path):
    where = run_installed("python", "-c", "import oneframe; print(oneframe.__file__)")
    assert not Path(where.stdout.strip()).is_relative_to(ROOT)
    assert run_installed("oneframe", "--version").stdout == f"oneframe {__version__}\n"
    ended = run_installed("oneframe", "check", tmp_path)
    assert ended.returncode == 2
    assert ended.stderr.startswith(f"error: {tmp_path}: expected the folder of a dataset")


@pytest.mark.render
def test_the_installed_program_renders_with_workers_and_checks(run_installed, write_tiny_case, tmp_path):
    write_tiny_case(tmp_path / "case")
    ended = run_installed("oneframe", "render", "case/case.toml", "--out", "out", "--count", "4", "--workers", "2")
    # a worker that does not start would be told here
    assert (ended.returncode, ended.stderr) == (0, "")
    ended = run_installed("oneframe", "check", "out", "--views", "0")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "dataset of 4 views: complete and consistent" in ended.stdout
    ended = run_installed("oneframe", "pack", "out", "--out", "packed", "--views-per-shard", "2", "--workers", "2")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert run_installed("oneframe", "pack", "--out", "packed", "--verify").returncode == 0
    ended = run_installed("oneframe", "report", "out", "--out", "page.html")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert b"Complete and consistent" in (tmp_path / "page.html").read_bytes()
    (tmp_path / "out" / "poses.csv").unlink()
    ended = run_installed("oneframe", "check", "out", "--fast")
    assert ended.returncode == 1
    assert "poses.csv" in ended.stdout


NETWORK = {
    "asyncio", "ensurepip", "ftplib", "http", "imaplib", "pip", "poplib", "requests", "smtplib", "socket",
    "socketserver", "ssl", "telnetlib", "urllib", "urllib3", "webbrowser", "xmlrpc",
}  # fmt: skip


@pytest.fixture(scope="module")
def staged(tmp_path_factory) -> Path:
    """The extension as it will be installed, without its wheel."""
    folder = tmp_path_factory.mktemp("extension") / "oneframe"
    build_extension.stage(folder, ["linux-x64"], [])
    return folder


def test_the_extension_does_what_its_permissions_say(staged):
    """As extensions.blender.org demands: no network and no installation at run time; no clipboard."""
    used: dict[str, set[str]] = {}
    for path in staged.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = {name.partition(".")[0] for name in imported(node)} & NETWORK
            if isinstance(node, ast.Constant) and node.value == "pip":
                names.add("pip")
            if isinstance(node, ast.Attribute) and node.attr == "clipboard":
                names.add("clipboard")
            for name in names:
                used.setdefault(name, set()).add(path.relative_to(staged).as_posix())
    assert used == {}
    manifest = tomllib.loads((staged / "blender_manifest.toml").read_text())
    assert set(manifest["permissions"]) == {"files"}


def test_the_add_on_imports_its_own_modules_relatively(staged):
    """A top-level module would be shared with every other add-on; only the scripts, in processes of their own, may."""
    own = {path.stem for path in staged.iterdir() if path.is_dir() or path.suffix == ".py"} | {"oneframe"}
    absolute = {
        (str(path.relative_to(staged)), name)
        for path in staged.rglob("*.py")
        if path.parent.name != "scripts"
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        for name in imported(node)
        if name.partition(".")[0] in own
    }
    assert absolute == set()


def imported(node: ast.AST) -> list[str]:
    """Names that a statement imports from the top level."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and node.level == 0:
        return [node.module or ""]
    return []
