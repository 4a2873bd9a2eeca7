"""``oneframe pack`` that gets a signal at a chosen change of the file system; see :mod:`interrupted_render`.

Call it with the signal's name, the number of the change, or -1, and a command line of ``oneframe pack``; it ends by
printing the number of changes.
"""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "outside")]

from interrupted_render import arm

from oneframe.commands import pack
from oneframe.process.arguments import run_command
from oneframe.process.command_line import run_script

if __name__ == "__main__":
    name, place, *arguments = sys.argv[1:]
    changes = arm(name, int(place), arguments[arguments.index("--out") + 1])
    sys.argv[1:] = arguments

    def run(argv: list[str]) -> int:
        code = run_command("oneframe pack", pack, argv)
        sys.stderr.write(f"{len(changes)}\n")
        return code

    run_script(run)
