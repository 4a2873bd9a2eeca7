"""Make the bone surface of a CT, less what was removed, and the structures of a label map, in one folder.

python scripts/ct_to_surface.py VOLUME --out DIR [--threshold HU|otsu] [--remove LABELS] [--labels LABELS] ...
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import surface
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: surface.main(argv, "ct_to_surface.py"))
