"""Views of a dataset or a pack for torch: at any place, and as a stream of shards.

Copy what you need: OneFrame does not depend on torch.
"""

from collections.abc import Iterator
from os import PathLike

import numpy as np
import torch
from torch.utils.data import Dataset as TorchDataset
from torch.utils.data import IterableDataset, get_worker_info

from oneframe.reader import View, open_dataset


def tensors(view: View) -> dict[str, torch.Tensor]:
    """A view as tensors that torch's default_collate makes a batch of."""
    return {
        "index": torch.tensor(view.index),
        "rgb": torch.from_numpy(view.rgb).permute(2, 0, 1),  # (3, H, W) uint8
        "depth_mm": torch.from_numpy(view.depth_mm),  # (H, W) float32
        "mask": torch.from_numpy(view.mask),  # (H, W) bool
        "observed": torch.from_numpy(view.observed),  # (H, W) bool: leave the rest out of a loss on colours
        "k": torch.from_numpy(view.k).float(),
        "cam_from_model": torch.from_numpy(view.cam_from_model).float(),
        "bbox_visib": torch.tensor(view.boxes.bbox_visib),
    }


class Views(TorchDataset):
    """Views at any place: for DataLoader(..., shuffle=True) on a local disk."""

    def __init__(self, path: str | PathLike[str]) -> None:
        self.views = open_dataset(path)

    def __len__(self) -> int:
        return len(self.views)

    def __getitem__(self, place: int) -> dict[str, torch.Tensor]:
        return tensors(self.views[place])


class StreamedViews(IterableDataset):
    """Views shard by shard: for packs on a shared disk, which is read from beginning to end.

    Each worker of a DataLoader gets shards of its own, so make at least as many shards as workers. Call set_epoch
    before each epoch: shards come in another order then. Views are mixed among the next ``buffer`` ones, which are read
    from the file only when their turn comes.
    """

    def __init__(
        self, path: str | PathLike[str], *, buffer: int = 256, seed: int = 0, rank: int = 0, world_size: int = 1
    ) -> None:
        self.views = open_dataset(path)
        self.buffer, self.seed, self.rank, self.world_size = buffer, seed, rank, world_size
        self.epoch = 0

    def set_epoch(self, epoch: int) -> None:
        self.epoch = epoch

    def __iter__(self) -> Iterator[dict[str, torch.Tensor]]:
        worker = get_worker_info()
        number, count = (0, 1) if worker is None else (worker.id, worker.num_workers)
        # the same order in all workers and on all machines, of which each takes its part
        order = np.random.default_rng((self.seed, self.epoch)).permutation(len(self.views.shards))
        mine = order[self.rank * count + number :: self.world_size * count]
        random = np.random.default_rng((self.seed, self.epoch, self.rank, number))
        waiting: list[View] = []
        for shard in mine:
            for place in self.views.shards[shard]:
                waiting.append(self.views[place])
                if len(waiting) >= self.buffer:
                    swap = int(random.integers(len(waiting)))
                    waiting[swap], waiting[-1] = waiting[-1], waiting[swap]
                    yield tensors(waiting.pop())
        random.shuffle(waiting)
        yield from map(tensors, waiting)
