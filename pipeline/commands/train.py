"""The command ``oneframe train``."""

from dataclasses import MISSING, dataclass
from pathlib import Path

from ..errors import InputError, naming
from ..process.command import option, positional
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


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    dataset: Path = positional("DATASET", "folder of a complete dataset or of a pack")
    out: Path = option("FILE.onnx", "file to write", MISSING)
    steps: int = option("N", "of 8 crops (default %(default)s)", 3000, least=1)
    seed: int = option("N", "of the crops (default %(default)s)", 0, least=0)


def run(arguments: Arguments) -> None:
    """Train the network and write its file."""
    from ..files.outputs import check_outputs, made_folder, write_output
    from ..learning.view_crops import ViewCrops
    from ..progress import Progress
    from ..reader import open_dataset

    out, output = arguments.out, own_output()
    views = open_dataset(arguments.dataset)
    check_outputs([out], {})
    if out.resolve().is_relative_to(arguments.dataset.resolve()):
        raise InputError(f"{out}: expected a file outside of the dataset; choose another folder")
    try:
        from ..learning.coordinate_network import onnx_file, trained_network
    except ImportError as error:
        raise InputError(
            f"train: expected PyTorch and onnx, {error.name} is not installed; run pip install torch onnx and try again"
        ) from None
    chosen = views[:: -(-len(views) // MOST_VIEWS)]
    with naming(arguments.dataset.name), Progress(len(chosen), "views read", stream=output) as progress:
        crops = ViewCrops.of(chosen, advance=progress.advance)
    with Progress(arguments.steps, "steps", stream=output) as progress:
        network = trained_network(crops, arguments.steps, arguments.seed, progress.advance)
    record = crops.record(chosen, arguments.steps, arguments.seed)
    write_output(made_folder(out), onnx_file(network, record))
    output.write(f"the network: {out}\n")
