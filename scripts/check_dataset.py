"""Check whether a dataset is complete and consistent: files, hashes, tables, images, and poses against pixels.

python scripts/check_dataset.py DIR [--views N] [--fast]
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import check
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: check.main(argv, "check_dataset.py"))
