"""Compare synthetic views with real photographs of the same poses, and measure their similarity.

python scripts/compare_views.py CASE.toml PHOTOGRAPHS.json --out DIR [--colour projective|texture|vertex]
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import compare
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: compare.main(argv, "compare_views.py"))
