"""The network: for each cell of 8x8 px, the point of the surface that it shows, how sure, and whether it shows any.

Scene coordinates by a convolutional network (Brachmann and Rother, TPAMI 2022). Needs PyTorch and ``onnx``.
"""

import io
import warnings
from collections.abc import Callable

import numpy as np
import onnx
import torch
from torch import nn
from torch.nn import functional

from .pose_network import KEY, MULTIPLE, NetworkRecord, network_input, sealed
from .view_crops import FULL, NOTHING, ViewCrops

BATCH = 8
LARGEST_RATE = 3e-3
WIDTHS = 24, 48, 64, 128
"""Channels at a half, a quarter, an eighth and a sixteenth of the image's size."""
BLOCKS = 3


class CoordinateNetwork(nn.Module):
    """Gives ``(B, 5, H / 8, W / 8)``: coordinates, the logarithm of their error, the logit of surface."""

    def __init__(self) -> None:
        super().__init__()
        half, quarter, eighth, sixteenth = WIDTHS
        self.fine = nn.Sequential(_conv(3, half, 5, 2), _conv(half, quarter, 3, 2), _conv(quarter, eighth, 3, 2))
        self.coarse = nn.Sequential(_conv(eighth, sixteenth, 3, 2), *(_Residual(sixteenth) for _ in range(BLOCKS)))
        self.widen = nn.Conv2d(sixteenth, eighth, 1)
        self.head = nn.Sequential(_Residual(eighth), nn.Conv2d(eighth, 5, 1))

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        fine = self.fine(image)
        return self.head(fine + functional.interpolate(self.widen(self.coarse(fine)), scale_factor=2.0))


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = _conv(width, width, 3, 1)
        self.second = nn.Sequential(nn.Conv2d(width, width, 3, padding=1, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return functional.relu(x + self.second(self.first(x)))


def _conv(before: int, after: int, size: int, stride: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(before, after, size, stride, size // 2, bias=False), nn.BatchNorm2d(after), nn.ReLU()
    )


def trained_network(crops: ViewCrops, steps: int, seed: int, advance: Callable[[], None]) -> CoordinateNetwork:
    """Train on random crops, with :data:`BATCH` of them in each step, after which ``advance`` is called."""
    # as quick as two for so small a network, and the sums do not depend on the machine's cores
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    network = CoordinateNetwork().to(memory_format=torch.channels_last).train()
    optimiser = torch.optim.AdamW(network.parameters(), LARGEST_RATE, weight_decay=1e-2, fused=True)
    rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, LARGEST_RATE, total_steps=steps, pct_start=0.15)
    for _ in range(steps):
        images, codes = zip(*(crops.crop(rng) for _ in range(BATCH)), strict=True)
        loss = _loss(_output(network, np.stack(images)), torch.from_numpy(np.stack(codes)))
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        rate.step()
        optimiser.zero_grad()
        advance()
    return network.eval()


def onnx_file(network: CoordinateNetwork, record: NetworkRecord) -> bytes:
    """The network as ONNX, for images of any size, with what it belongs to in its metadata."""
    content, image = io.BytesIO(), torch.zeros(1, 3, 2 * MULTIPLE, 2 * MULTIPLE)
    sizes = {name: {0: "images", 2: f"{name} rows", 3: f"{name} columns"} for name in ("image", "cells")}
    with warnings.catch_warnings():
        # of the exporter's age: the newer one needs a further package
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network, (image,), content, dynamo=False, input_names=["image"], output_names=["cells"], dynamic_axes=sizes
        )
    model = onnx.load_from_string(content.getvalue())
    onnx.helper.set_model_props(model, {KEY: record.text()})
    return sealed(model.SerializeToString())


def _output(network: CoordinateNetwork, images: np.ndarray) -> torch.Tensor:
    return network(torch.from_numpy(network_input(images)))


def _loss(output: torch.Tensor, codes: torch.Tensor) -> torch.Tensor:
    """L1 for the coordinates; Laplace's likelihood for their error, which does not move them; entropy for surface."""
    truth, seen = codes.permute(0, 3, 1, 2).float() / FULL, codes[..., 0] != NOTHING
    surface = functional.binary_cross_entropy_with_logits(output[:, 4], seen.float())
    error = (output[:, :3] - truth).norm(dim=1)[seen]
    log_scale = output[:, 3][seen]
    sure = (error.detach() * torch.exp(-log_scale) + 3 * log_scale).mean()
    return 10 * error.mean() + 0.1 * sure + surface
