"""Find the best frames of a microscope video: sharp, well exposed, free of instruments, hands and glare.

python scripts/select_frame.py VIDEO --out DIR [--count N] [--every N] [--from S] [--to S]
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import frames
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: frames.main(argv, "select_frame.py"))
