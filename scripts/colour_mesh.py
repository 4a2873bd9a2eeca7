"""Write the surface with the frame's colours on it, as GLB, OBJ or PLY.

python scripts/colour_mesh.py CASE.toml --out surface.glb [--colour texture|vertex]
blender -b -P scripts/colour_mesh.py -- CASE.toml --out surface.glb
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import colour
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: colour.main(argv, "colour_mesh.py"))
