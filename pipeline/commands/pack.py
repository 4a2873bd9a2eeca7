"""The command ``oneframe pack``."""

import os
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TextIO

from ..errors import InputError
from ..process.arguments import resumable
from ..process.command import choice, option, positional, switch
from ..process.own_process import own_output

EXIT_WRONG = 1

ABOUT = "Pack a dataset for training: WebDataset shards in BOP's layout, which stream and need no other folder."
EPILOG = """examples:
  %(prog)s dataset --out packed
  %(prog)s dataset --out packed --views-per-shard 500 --jpeg 95
  %(prog)s dataset --out test --split test  (a tenth of the views, unlike those of train and val)
  %(prog)s --out packed --verify

Run the same command again to continue a stopped run. The bytes do not depend on who packs; those of JPEG depend on the
version of OpenCV.

--verify compares size and hash of every file of a pack, and needs no dataset. Its exit code: 0 whole; 1 something is
wrong; 2 no pack, or wrong arguments. To repair a pack, remove the files that it names and pack again.
"""


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    dataset: Path | None = positional("DIR", "folder of the complete dataset", None)
    out: Path = option("PACKED", "folder of the pack; an unfinished one is resumed", MISSING)
    views_per_shard: int = option("N", "views in each tar file (default %(default)s, as in BOP's own packs)", 1000)
    jpeg: int | None = option("QUALITY", "store RGB as JPEG of this quality, 1 to 100")
    split: str | None = choice(
        "pack only the views of this part (80, 10 and 10 %%); no view of a part is like one of another, by the "
        "distance of their poses", choices=("train", "val", "test")
    )  # fmt: skip
    split_gap_px: float | None = option(
        "X", "least distance of views in different parts: RMS displacement of the surface's box in the image "
        "(default: 1 %% of the image's longer side)"
    )  # fmt: skip
    workers: int = option("N", "number of threads (default: one per core)", 0, least=0)
    verify: bool = switch("pack nothing: compare the files of the pack with their hashes")


@resumable()
def run(arguments: Arguments) -> int:
    """Pack the dataset, or verify the pack."""
    if arguments.split_gap_px is not None and arguments.split is None:
        raise InputError("command line: --split-gap-px: expected with --split only; add it, or leave out both")
    dataset = arguments.dataset
    if (dataset is None) != arguments.verify:
        raise InputError("command line: expected the folder of the dataset, DIR, or --verify without it")
    # the arrays are small: numpy's BLAS threads would only take memory
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from ..dataset.layout import datasets_in

    output = own_output()
    if dataset is None:
        return _verify(arguments, output)
    from ..packing.pack import PackOptions, pack_dataset

    views, about = None, ""
    if arguments.split is not None:
        from ..packing.split import split_of_dataset
        from ..packing.whole_dataset import open_whole_dataset

        split = split_of_dataset(open_whole_dataset(dataset), gap_px=arguments.split_gap_px)
        output.write(f"split: {split.text()}\n")
        views, about = split.part(arguments.split), f"{arguments.split}, of {split.text()}"
    for each in datasets_in(dataset):
        out = arguments.out / each.relative_to(dataset)
        manifest = pack_dataset(
            each,
            out,
            PackOptions(arguments.views_per_shard, arguments.jpeg, about),
            views=views,
            workers=arguments.workers,
            stream=output,
        )
        shards = [known for name, known in manifest.files.items() if name.endswith(".tar")]
        output.write(
            f"pack of {len(manifest.plan.views)} views, {sum(each.bytes for each in shards) / 1e6:.0f} MB in "
            f"{len(shards)} shard{'s' * (len(shards) != 1)}: {out}\n"
        )
    return 0


def _verify(arguments: Arguments, output: TextIO) -> int:
    """Compare the pack with its hashes."""
    from ..dataset.layout import datasets_in
    from ..files.machine import available_cores
    from ..packing.pack import verify_pack

    problems = 0
    for folder in datasets_in(arguments.out):
        wrong = verify_pack(folder, threads=arguments.workers or available_cores(), stream=output)
        output.writelines(f"{line}\n" for line in wrong)
        output.write(f"{folder}: {f'NOT whole, {len(wrong)} findings' if wrong else 'whole (all hashes)'}\n")
        problems += len(wrong)
    return EXIT_WRONG if problems else 0
