"""Put surface, structures, frame, mask and K into a case folder, with a case.toml that all other commands take.

python scripts/new_case.py --surface DIR --frame FILE --camera FILE --out DIR [--mask FILE] [--pose FILE] ...
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import case
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: case.main(argv, "new_case.py", align="align.py"))
