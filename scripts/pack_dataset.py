"""Pack a dataset for training: WebDataset shards in BOP's layout.

python scripts/pack_dataset.py DIR --out PACKED [--views-per-shard 1000] [--jpeg QUALITY] [--verify]
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parent))

from oneframe.commands import pack
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    run_script(lambda argv: pack.main(argv, "pack_dataset.py"))
