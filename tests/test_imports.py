"""What no contract on imports can prove: what renders runs in a stock Blender, and the package can be vendored."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PURE = sorted(
    ".".join(["oneframe", *path.relative_to(ROOT / "pipeline").with_suffix("").parts])
    for path in (ROOT / "pipeline").rglob("*.py")
    # the last needs PyTorch
    if path.stem not in ("__init__", "script", "coordinate_network")
    and (ROOT / "pipeline" / "blender") not in path.parents
)


def run(code: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)


def test_pure_modules_import_where_there_is_no_blender():
    names = ", ".join(PURE)
    ended = run(f"import sys; sys.modules.update(bpy=None, mathutils=None)\nimport {names}")
    assert ended.returncode == 0, ended.stderr


def test_what_needs_no_blender_is_not_in_its_room():
    room = ROOT / "pipeline" / "blender"
    imported = {path: imports_of(path) for path in room.rglob("*.py") if path.stem != "__init__"}
    needing = {path for path, names in imported.items() if names & {"bpy", "mathutils"}}
    while further := {path for path in imported.keys() - needing if imported[path] & {each.stem for each in needing}}:
        needing |= further
    assert imported.keys() - needing == set()


def imports_of(path: Path) -> set[str]:
    """The last names of the modules of the room that one of it imports, and the packages."""
    found = set[str]()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {each.name for each in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level != 3:
            found |= {(node.module or "").rpartition(".")[2], *(each.name for each in node.names)}
    return found


@pytest.mark.render
def test_rendering_needs_nothing_that_a_stock_blender_lacks(write_tiny_case, tmp_path):
    missing = ("av", "cv2", "isal", "numba", "skimage", "scipy", "yaml", "PIL", "trimesh", "OpenImageIO")
    case, out = write_tiny_case(tmp_path / "case"), tmp_path / "out"
    # the dataset's overlay shows it
    structure = '[[structures]]\nname = "nerve"\nmesh = "surface.ply"\ncolor = "#ff00ff"\n'
    case.write_text(case.read_text() + structure)
    ended = run(
        f"import sys; sys.modules.update(dict.fromkeys({missing!r}))\n"
        f"sys.argv[1:] = [{str(case)!r}, '--out', {str(out)!r}, '--count', '2', '--workers', '1']\n"
        "import runpy; runpy.run_path('scripts/render_dataset.py', run_name='__main__')"
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    assert (out / "poses.csv").is_file()


def test_only_k_in_yaml_needs_a_package(tmp_path):
    (tmp_path / "k.json").write_text('{"fx": 500, "fy": 500, "cx": 160, "cy": 120}')
    (tmp_path / "k.yaml").write_text("fx: 500\nfy: 500\ncx: 160\ncy: 120\n")
    ended = run(
        "import pathlib, sys; sys.modules['yaml'] = None\n"
        "from oneframe.camera.intrinsics_file import read_camera\n"
        f"for name in ('k.json', 'k.yaml'): read_camera(pathlib.Path({str(tmp_path)!r}, name))"
    )
    assert "InputError: k.yaml: expected the package PyYAML" in ended.stderr


def test_the_add_on_of_a_checkout_shares_the_pipeline():
    """Two copies of a class would make ``except InputError`` miss the other's errors."""
    ended = run(
        "import blender_addon, sys\n"
        "copies = {name: module for name, module in sys.modules.items() if name.startswith('blender_addon.pipeline')}\n"
        "assert copies\n"
        "for name, module in copies.items():\n"
        "    own = name.replace('blender_addon.pipeline', 'oneframe')\n"
        "    assert module is sys.modules[own] and module.__spec__.name == own, name\n"
    )
    assert ended.returncode == 0, ended.stderr


def test_no_test_depends_on_the_speed_of_its_machine():
    """One module waits, for minutes; a user's hands, a browser and a Slurm have limits of their own, as long."""
    own = ("waiting.py", "chromium.py", "user.py", "driver.py")
    clock = re.compile(r"\b(perf_counter|process_time|monotonic)\(|\btimeout=[0-9]|\bdeadline=[^N]")
    for path in (ROOT / "tests").rglob("*.py"):
        found = None if path.name in own or path == Path(__file__) else clock.search(path.read_text())
        assert not found, f"{path}: {found}"
