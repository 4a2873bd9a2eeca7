"""The layers: what is pure runs without Blender, what renders runs in a stock Blender, all of it can be vendored."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PURE = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for folder in ("pipeline", "pipeline/alignment")
    for path in (ROOT / folder).glob("*.py")
    if path.stem != "__init__"
)


def run(code: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)


def test_pure_modules_import_where_there_is_no_blender():
    names = ", ".join(PURE)
    ended = run(f"import sys; sys.modules.update(bpy=None, mathutils=None)\nimport {names}")
    assert ended.returncode == 0, ended.stderr


def test_rendering_needs_nothing_that_a_stock_blender_lacks():
    missing = ("cv2", "skimage", "scipy", "PIL", "trimesh", "OpenImageIO")
    ended = run(
        f"import sys; sys.modules.update(dict.fromkeys({missing!r}))\n"
        "import runpy; runpy.run_path('scripts/render_dataset.py', run_name='imported')"
    )
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize("path", sorted((ROOT / "pipeline").rglob("*.py")), ids=lambda path: path.stem)
def test_modules_name_each_other_relatively(path):
    """So that the add-on can carry the package inside its own."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            assert not any(alias.name.split(".")[0] == "pipeline" for alias in node.names)
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            assert (node.module or "").split(".")[0] != "pipeline"
