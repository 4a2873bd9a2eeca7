"""Evaluate as in the paper: score views against real photographs, with the paper's own method beside them.

python scripts/evaluate.py CASE.toml PHOTOGRAPHS.json [--case CASE.toml PHOTOGRAPHS.json ...] --out DIR
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import evaluate
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: evaluate.main(argv, "evaluate.py"))
