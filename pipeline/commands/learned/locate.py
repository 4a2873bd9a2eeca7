"""The command ``oneframe locate``."""

import argparse
from pathlib import Path

from .. import register

ABOUT = "Find the pose of further frames as oneframe register does, and by a trained network where features fail."
EPILOG = """examples:
  %(prog)s network.onnx case.toml surgery.mp4 --out located
  %(prog)s network.onnx case.toml frames --out located

MODEL is what oneframe train wrote, of views of this surface. A frame in which features find no pose that is accepted
starts at the network's, is refined and judged like any other, and DIR gets what oneframe register writes. No PyTorch
is needed.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("model", metavar="MODEL.onnx", type=Path, help="the network of oneframe train")
    register.add_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Register the frames with the network."""
    register.register(arguments, arguments.model)
