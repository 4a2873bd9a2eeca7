"""Render a dataset of posed views from one aligned frame.

python scripts/render_dataset.py CASE.toml --out DIR [options]
blender -b -P scripts/render_dataset.py -- CASE.toml --out DIR [options]
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import render
from oneframe.process.command import run_command
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: run_command("render_dataset.py", render, argv))
