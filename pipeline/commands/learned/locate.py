"""The command ``oneframe locate``."""

import argparse
from pathlib import Path

from .. import register

ABOUT = "Find the pose of further frames by a trained network, and as oneframe register does where it fails."
EPILOG = """examples:
  %(prog)s network.onnx case.toml surgery.mp4 --out located
  %(prog)s network.onnx case.toml frames --out located

MODEL is what oneframe train wrote, of views of this surface. A frame starts at the network's pose, is refined and
judged like any other; where that is not accepted, the network sees it in the colours' range of the case's frame, then
features are tried as in oneframe register, and the most probable pose counts. DIR gets what oneframe register writes.
No PyTorch is needed.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("model", metavar="MODEL.onnx", type=Path, help="the network of oneframe train")
    register.add_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Register the frames with the network."""
    register.register(arguments, arguments.model)
