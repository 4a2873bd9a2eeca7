"""Find the pose of a frame from landmarks and report its uncertainty, or refine the pose against the image.

python scripts/align.py CASE.toml [--landmarks FILE] [--refine] [--out CASE] [--json JSON] [--picture PNG]
blender -b -P scripts/align.py -- CASE.toml ...        (a Blender in which the OneFrame extension is enabled)
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import align
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: align.main(argv, "align.py"))
