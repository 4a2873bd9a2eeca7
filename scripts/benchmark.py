"""Measure speed, accuracy and stability beside other programs, on this machine.

    python scripts/benchmark.py TOPIC --out PATH [--quick] [--redraw]

Topics: speed (against PyVista), chart (speed against accuracy), landmarks (accuracy of poses), evaluation (on published
photographs), registration (of further frames), stability (where methods fail), training (what views are worth),
real (on a real endoscopy). TOPIC --help describes one.
--quick only shows that it runs; --redraw draws the charts again from --out.
"""

import os
import sys
from pathlib import Path

# before numpy is imported: the matrices are small, so BLAS threads cost more than they save
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# the repository's root, for the benchmarks, and the folder where the package is found by its name
sys.path[:0] = [str(Path(__file__).resolve().parents[1]), str(Path(__file__).resolve().parent)]

import argparse
from collections.abc import Sequence
from importlib import import_module

from oneframe.process.arguments import ArgumentParser
from oneframe.process.command_line import run_script
from oneframe.process.own_process import own_output
from scripts.benchmarks.charts.page import require_matplotlib

TOPICS = ("speed", "chart", "landmarks", "evaluation", "registration", "stability", "training", "real")


def main(argv: Sequence[str]) -> int:
    """Measure a topic, and draw its charts.

    A topic is a module with a docstring for its help, ``add_arguments``, the defaults of its ``QUICK`` form,
    ``measure``, which writes ``--out``, and mostly ``draw``, which draws charts from ``--out`` and gives their paths.
    """
    topics = ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    topics.add_argument("topic", choices=TOPICS)
    name = topics.parse(argv[:1]).topic
    topic = import_module(f"scripts.benchmarks.{name}")
    draw = getattr(topic, "draw", None)
    parser = ArgumentParser(
        prog=f"benchmark.py {name}", description=topic.__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", metavar="PATH", type=Path, required=True, help="where the figures go")
    parser.add_argument("--quick", action="store_true", help="little of everything: does it run?")
    if draw:
        parser.add_argument("--redraw", action="store_true", help="measure nothing; draw again from --out")
    topic.add_arguments(parser)
    if "--quick" in argv:
        parser.set_defaults(**topic.QUICK)
    arguments = parser.parse(argv[1:])
    if draw:
        require_matplotlib()
    output = own_output()

    def report(line: str) -> None:
        output.write(line + "\n")
        output.flush()

    if not (draw and arguments.redraw):
        topic.measure(arguments, report)
    for path in draw(arguments.out) if draw else ():
        report(str(path))
    return 0


if __name__ == "__main__":
    run_script(main)
