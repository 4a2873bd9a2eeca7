"""Draw surface and structures over the frame, or over each frame of a video, as augmented reality shows them.

python scripts/overlay.py CASE.toml --out PNG [--under-instruments] [--plain]
python scripts/overlay.py CASE.toml --video FILE --poses FILE --out MP4
blender -b -P scripts/overlay.py -- CASE.toml ...      (with --video: one in which the OneFrame extension is enabled)
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import overlay
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: overlay.main(argv, "overlay.py"))
