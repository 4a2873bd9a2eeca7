"""Make one HTML page of a dataset or an evaluation, to look at in any browser, without a network.

python scripts/report.py DIR --out FILE.html [--views N] [--no-check] [--case CASE.toml]
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import report
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: report.main(argv, "report.py"))
