"""Open a real Blender with this checkout's add-on and the sample case, without using the user's configuration.

python scripts/dev/addon_dev.py --blender PROGRAM [--case CASE.toml] [-- Blender's own arguments]
"""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# the package and the other scripts, also where nothing is installed
sys.path[:0] = [str(ROOT), str(ROOT / "scripts")]

import argparse
import os
import shutil
import subprocess
from collections.abc import Sequence

from oneframe.errors import InputError, RunError
from scripts.dev import build_extension

RESOURCES = ROOT / "build" / "addon-dev"
SAMPLE = ROOT / "demo" / "case" / "case.toml"
OPEN_CASE = """
import bpy
bpy.context.preferences.view.show_splash = False
def open_case():
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    region = next(region for region in area.regions if region.type == "WINDOW")
    if region.width <= 1:
        return 0.1
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.oneframe.open_case(filepath={case!r})
# once the window is laid out
bpy.app.timers.register(open_case, first_interval=0.1)
"""


def parse_arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="addon_dev.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--blender", metavar="PROGRAM", default=os.environ.get("BLENDER"), help="default: $BLENDER")
    parser.add_argument("--case", metavar="CASE.toml", type=Path, default=SAMPLE, help="default: the sample case")
    parser.add_argument("flags", nargs="*", metavar="-- FLAGS", help="arguments for Blender itself")
    return parser.parse_args(argv)


def install(blender: str, resources: Path) -> None:
    """Build the extension for this platform, install it and enable it."""
    (package,) = build_extension.build([build_extension.this_platform()], ROOT / "build")
    command = [blender, "--command", "extension", "install-file", "-r", "user_default", "--enable", str(package)]
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(resources)}
    ended = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if ended.returncode != 0:
        lines = (ended.stderr.strip() or ended.stdout.strip() or f"status {ended.returncode}").splitlines()
        raise RunError(f"{blender} cannot install the extension: {lines[-1]}")


def main(argv: Sequence[str]) -> int:
    arguments = parse_arguments(argv)
    try:
        if (blender := shutil.which(arguments.blender or "")) is None:
            raise InputError(
                f"expected a Blender program, found {arguments.blender or 'none'!r}; name one: make addon-dev "
                "BLENDER=/path/to/blender"
            )
        install(blender, RESOURCES)
        case = arguments.case.resolve()
        if case == SAMPLE and not case.exists():
            print("making the sample case (half a minute, once)", flush=True)
            subprocess.run(
                [sys.executable, ROOT / "scripts" / "oneframe.py", "sample", "--out", case.parent], check=True
            )
    except (InputError, RunError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2 if isinstance(error, InputError) else 3
    print(f"opening {case} in {blender}", flush=True)
    command = [blender, *arguments.flags, "--python-expr", OPEN_CASE.format(case=str(case))]
    os.execve(blender, command, os.environ | {"BLENDER_USER_RESOURCES": str(RESOURCES)})


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
