"""The installed extension: built, validated, enabled, disabled and removed by Blender's own code."""

import json
import os
import re
import subprocess
import sys
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from oneframe import __version__
from scripts.dev import build_extension

HERE = Path(__file__).resolve().parent
TABLE = re.compile(r"^(platforms|wheels) = .*$", re.MULTILINE)


@pytest.fixture(scope="module")
def stock_python(tmp_path_factory) -> Path:
    """A folder with the modules that Blender contains and no others: no cv2, no skimage, not this project."""
    site = tmp_path_factory.mktemp("stock")
    pending, seen = ["bpy"], set()
    while pending:
        name = pending.pop()
        if name in seen:
            continue
        seen.add(name)
        distribution = metadata.distribution(name)
        for top in {file.parts[0] for file in distribution.files or ()} - {"..", "__pycache__"}:
            if not (site / top).exists():
                (site / top).symlink_to(distribution.locate_file(top))
        wanted = map(Requirement, distribution.requires or ())
        pending += [some.name for some in wanted if not some.marker or some.marker.evaluate({"extra": ""})]
    return site


@pytest.fixture
def run_stock(stock_python, tmp_path):
    """Runs a script in that environment; BLENDER_USER_RESOURCES is ``tmp_path/resources``."""

    def run(*command: str | Path) -> subprocess.CompletedProcess:
        environment = {"PYTHONPATH": str(stock_python), "BLENDER_USER_RESOURCES": str(tmp_path / "resources")}
        # -S: the site-packages of the tests stay out
        return subprocess.run(
            [sys.executable, "-S", "-P", *map(str, command)],
            capture_output=True,
            text=True,
            check=False,
            cwd=tmp_path,
            env=os.environ | environment,
        )

    return run


@pytest.fixture
def installed(extension_zip, tmp_path) -> Path:
    """The extension in the folder that "Install from Disk" uses."""
    folder = tmp_path / "resources" / "extensions" / "user_default" / "oneframe"
    with zipfile.ZipFile(extension_zip) as archive:
        archive.extractall(folder)
    return folder


def test_is_enabled_disabled_and_removed_without_leftovers(installed, run_stock, tmp_path):
    ended = run_stock(HERE / "extension_life.py")
    assert ended.returncode == 0, ended.stderr
    assert ended.stderr == ""
    assert "Policy violation" not in ended.stdout
    messages = json.loads(ended.stdout.splitlines()[-1])
    assert "Scene.oneframe" in messages["added"]["properties"]
    assert {name for name in messages["added"]["operators"] if not name.startswith("oneframe.")} == set()
    assert messages["added"]["operators"] != []
    assert (messages["warnings"], messages["left"], messages["held"]) == ({}, {}, [])
    resources = tmp_path / "resources"
    assert Path(messages["cv2"]).is_relative_to(resources / "extensions" / ".local")
    assert not Path(messages["numpy"]).is_relative_to(resources)
    assert not installed.exists()
    assert list(resources.rglob("cv2")) == []


@pytest.mark.render
def test_renders_with_blenders_own_modules(installed, run_stock, write_tiny_case, tmp_path):
    """As the add-on's dataset job does: with the scripts and the package inside the extension."""
    case, out = write_tiny_case(tmp_path / "case"), tmp_path / "out"
    ended = run_stock(installed / "scripts" / "render_dataset.py", case, "--out", out, "--count", "2", "--workers", "1")
    assert ended.returncode == 0, ended.stderr
    assert ended.stderr == ""
    traced = run_stock(installed / "scripts" / "render_dataset.py", case, "--out", tmp_path / "new", "--engine=raster")
    assert (traced.returncode, traced.stderr.count("\n")) == (2, 1)
    assert "expected the package numba in this Python, found none; install it" in traced.stderr


def test_the_build_adds_version_platforms_and_wheels_to_the_manifest(extension_zip):
    """Everything else is the manifest of the source."""
    with zipfile.ZipFile(extension_zip) as archive:
        built = archive.read("blender_manifest.toml").decode()
        files = archive.namelist()
    source = (build_extension.ROOT / "blender_addon" / "blender_manifest.toml").read_text()
    written, _, _ = TABLE.sub("", built).partition("\n\n# BEGIN GENERATED")
    expected = source.replace(build_extension.VERSION_LINE, f'version = "{__version__}"\n\n')
    assert "".join(written.split()) == "".join(expected.split())
    assert extension_zip.name == f"oneframe-{__version__}-{build_extension.this_platform().replace('-', '_')}.zip"
    wheels = [Path(name).name.partition("-")[0].lower() for name in files if name.endswith(".whl")]
    assert sorted(wheels) == [
        "av", "isal", "lazy_loader", "llvmlite", "numba", "opencv_contrib_python_headless", "pyfqmr", "pyyaml",
        "scikit_image",
        "scipy", "simpleitk",
    ]  # fmt: skip
    assert not any("__pycache__" in name for name in files)
    for name in (
        "LICENSE",
        "pipeline/blender/render/engines.py",
        "scripts/render_dataset.py",
        "scripts/oneframe.py",
    ):
        assert name in files
