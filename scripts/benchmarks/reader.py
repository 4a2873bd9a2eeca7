"""How many views a second the reader gives, beside OpenCV alone on the same files in the same run.

The views are packed into a temporary folder, as PNG and as JPEG. Every round reads them all in each way, one after
another, so that a busy computer slows all ways down; the best round of each counts. "All" is RGB, depth, both masks,
K, pose and boxes; OpenCV alone reads the four images. Files are in the system's cache, and OpenCV uses one thread.
"""

import argparse
import os
import platform
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from oneframe.dataset.layout import ViewPaths
from oneframe.errors import InputError
from oneframe.files.machine import available_cores
from oneframe.files.temporary import temporary_folder
from oneframe.packing.pack import PackOptions, pack_dataset
from oneframe.reader import Dataset, open_dataset

from .figures import write_figures

PARTS = {"rgb": ("rgb",), "all": ("rgb", "depth_mm", "mask", "observed", "k", "cam_from_model", "boxes")}
IMAGES = ("rgb", "depth", "mask_visib", "mask_observed")
QUICK = {"views": 10, "rounds": 1}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument("dataset", metavar="DATASET", type=Path, help="folder of a dataset")
    parser.add_argument("--views", metavar="N", type=int, default=200, help="use the first N views")
    parser.add_argument("--rounds", metavar="N", type=int, default=5)
    parser.add_argument("--jpeg", metavar="QUALITY", type=int, default=95)


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Read in all ways."""
    cv2.setNumThreads(1)
    with temporary_folder() as folder:
        figures = measured(arguments.dataset, folder, arguments.views, arguments.rounds, arguments.jpeg)
    for name, speeds in figures["views_per_second"].items():
        report(f"{name:24}" + "".join(f"{what} {speed:7.1f}/s   " for what, speed in speeds.items()))
    report(f"JPEG of quality {arguments.jpeg}: {figures['jpeg_loss']}")
    write_figures(arguments.out, figures)


def measured(root: Path, folder: Path, views: int, rounds: int, quality: int) -> dict:
    """Views per second by way of reading and what is read, and what they were measured on."""
    dataset = open_dataset(root)[:views]
    numbers = list(dataset.views)
    with open(os.devnull, "w") as nowhere:
        packs = {
            name: pack_dataset(root, folder / name, PackOptions(jpeg_quality=jpeg), views=numbers, stream=nowhere)
            for name, jpeg in (("pack", None), (f"pack, JPEG {quality}", quality))
        }
    # as many shards as BOP has: views far from each other
    shuffled = np.random.default_rng(0).permutation(len(numbers)).tolist()
    rgb_files = [str(ViewPaths(root, view).file("rgb")) for view in numbers]
    all_files = [str(ViewPaths(root, view).file(kind)) for view in numbers for kind in IMAGES]
    sources = {"folder": dataset, **{name: open_dataset(folder / name) for name in packs}}
    ways: dict[str, dict[str, Callable[[], object]]] = {
        "OpenCV alone": {"rgb": lambda: decode(rgb_files), "all": lambda: decode(all_files)}
    }
    for name, source in sources.items():
        ways[name] = {what: partial(read, source, range(len(numbers)), parts) for what, parts in PARTS.items()}
    pack = sources["pack"]
    ways["pack, random places"] = {what: partial(read, pack, shuffled, parts) for what, parts in PARTS.items()}
    cores = available_cores()
    with ThreadPoolExecutor(cores) as pool:
        shares = [range(first, len(numbers), cores) for first in range(cores)]

        def read_by_threads(parts: Sequence[str]) -> None:
            list(pool.map(lambda share: read(pack, share, parts), shares))

        ways[f"pack, {cores} threads"] = {what: partial(read_by_threads, parts) for what, parts in PARTS.items()}
        best: dict[str, dict[str, float]] = {name: dict.fromkeys(parts, 0.0) for name, parts in ways.items()}
        for _ in range(rounds):
            for name, parts in ways.items():
                for what, run in parts.items():
                    begin = time.perf_counter()
                    run()
                    best[name][what] = max(best[name][what], len(numbers) / (time.perf_counter() - begin))
    return {
        "views_per_second": best,
        "megabytes": {name: sum(shard.bytes for shard in made.shards) / 1e6 for name, made in packs.items()},
        "jpeg_loss": jpeg_loss(dataset, sources[f"pack, JPEG {quality}"]),
        "views": len(numbers),
        "size": list(dataset.size_wh),
        "rounds": rounds,
        "machine": {"processors": cores, "python": platform.python_version(), "opencv": cv2.__version__},
    }


def jpeg_loss(sound: Dataset, compressed: Dataset) -> str:
    """The differences of RGB, over all channels of all views."""
    errors = (np.abs(one.rgb.astype(float) - other.rgb) for one, other in zip(sound, compressed, strict=True))
    mean, square, largest = np.transpose([(error.mean(), (error**2).mean(), error.max()) for error in errors])
    psnr_db = 10 * np.log10(255**2 / square.mean())
    return f"mean error {mean.mean():.2f} of 255, largest {largest.max():.0f}, PSNR {psnr_db:.1f} dB"


def decode(files: Iterable[str]) -> None:
    """Read images as OpenCV's users do."""
    for file in files:
        if cv2.imread(file, cv2.IMREAD_UNCHANGED) is None:
            raise InputError(f"{file}: expected an image; check the dataset (oneframe check)")


def read(views: Dataset, places: Iterable[int], parts: Sequence[str]) -> None:
    """Ask views for their parts, and keep nothing."""
    for place in places:
        view = views[place]
        for name in parts:
            getattr(view, name)
