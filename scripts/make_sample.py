"""Make the built-in sample case: a drilled temporal bone, a microscope frame of it, and held-out photographs.

python scripts/make_sample.py --out DIR
blender -b -P scripts/make_sample.py -- --out DIR        (a Blender whose Python has scikit-image)
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import sample
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: sample.main(argv, "make_sample.py", render="render_dataset.py"))
