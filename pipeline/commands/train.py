"""The command ``oneframe train``."""

import argparse
from pathlib import Path

from ..errors import InputError, naming
from ..process.arguments import at_least
from ..process.own_process import own_output

ABOUT = "Train a network on the views of a dataset, which finds first poses of frames for oneframe register --network."
EPILOG = """examples:
  %(prog)s dataset --out network.onnx
  %(prog)s dataset --out network.onnx --steps 6000

Views for it: oneframe render case.toml --out dataset --for-training --count 300 --scale 0.2

It learns from the views alone which point of the surface is seen where; crops of them are turned, zoomed, relit, partly
hidden and put on random backgrounds meanwhile. Views are made as small as the network needs them, and of more than
2000 some are taken, evenly. FILE is ONNX, which OpenCV runs: registering with it needs no PyTorch.

Training needs PyTorch and the package onnx: pip install torch onnx. The file appears at the end.
"""
MOST_VIEWS = 2000
"""More taught no more, and take memory."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("dataset", metavar="DATASET", type=Path, help="folder of a complete dataset or of a pack")
    parser.add_argument("--out", metavar="FILE.onnx", type=Path, required=True, help="file to write")
    parser.add_argument("--steps", metavar="N", type=at_least(1), default=3000, help="of 8 crops (default %(default)s)")
    parser.add_argument("--seed", metavar="N", type=at_least(0), default=0, help="of the crops (default %(default)s)")


def run(arguments: argparse.Namespace) -> None:
    """Train the network and write its file."""
    try:
        from ..learning.coordinate_network import onnx_file, trained_network
    except ImportError as error:
        raise InputError(
            f"train: expected PyTorch and onnx, {error.name} is not installed; run pip install torch onnx and try again"
        ) from None
    from ..files.outputs import check_outputs, made_folder, write_output
    from ..learning.view_crops import ViewCrops
    from ..progress import Progress
    from ..reader import open_dataset

    out, output = arguments.out, own_output()
    with open_dataset(arguments.dataset) as views:
        check_outputs([out], {})
        if out.resolve().is_relative_to(arguments.dataset.resolve()):
            raise InputError(f"{out}: expected a file outside of the dataset; choose another folder")
        chosen = views[:: -(-len(views) // MOST_VIEWS)]
        with naming(arguments.dataset.name), Progress(len(chosen), "views read", stream=output) as progress:
            crops = ViewCrops.of(chosen, advance=progress.advance)
    with Progress(arguments.steps, "steps", stream=output) as progress:
        network = trained_network(crops, arguments.steps, arguments.seed, progress.advance)
    record = crops.record(chosen, arguments.steps, arguments.seed)
    write_output(made_folder(out), onnx_file(network, record))
    output.write(f"the network: {out}\n")
