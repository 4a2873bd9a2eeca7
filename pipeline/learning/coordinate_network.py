"""The network: for each cell of 8x8 px, the point of the surface that it shows, how sure, and whether it shows any.

Scene coordinates (Shotton et al., CVPR 2013) by a convolutional network (Brachmann and Rother, TPAMI 2022). Needs
PyTorch.
"""

from collections.abc import Callable

import cv2
import numpy as np
import torch
from torch import nn
from torch.nn import functional

from oneframe.camera.pinhole import PinholeCamera
from oneframe.images.pixel_values import to_uint8

from .pose_trials import pose_of
from .view_crops import FULL, MULTIPLE, NOTHING, STRIDE, ViewCrops

BATCH = 8
LARGEST_RATE = 3e-3
WIDTHS = 24, 48, 64, 128
"""Channels at a half, a quarter, an eighth and a sixteenth of the image's size."""
BLOCKS = 3
TURNS_DEG = (-12, -4, 4, 12)
"""Of the copies of a photograph: their errors partly cancel."""


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


def network_pose(
    network: CoordinateNetwork, crops: ViewCrops, camera: PinholeCamera, image: np.ndarray
) -> np.ndarray | None:
    """``cam_from_model`` of an image ``(H, W, 3)`` float32 of any size, seen by the network at the camera's."""
    codes = to_uint8(cv2.resize(image, camera.size_wh, interpolation=cv2.INTER_AREA))
    pixels, points, errors = np.split(predicted(network, codes), [2, 5], axis=1)
    return pose_of(points * crops.reach_mm + crops.centre_model, pixels, errors[:, 0] * crops.reach_mm, camera)


def predicted(network: CoordinateNetwork, image: np.ndarray) -> np.ndarray:
    """What the network sees in an image ``(H, W, 3)`` uint8 and in turned copies, where it shows the surface.

    Returns
    -------
    ``(N, 6)``: pixel, coordinates, and the error that the network states of them.
    """
    height, width = image.shape[:2]
    padded_wh = -(-width // MULTIPLE) * MULTIPLE, -(-height // MULTIPLE) * MULTIPLE
    v, u = STRIDE * np.mgrid[: padded_wh[1] // STRIDE, : padded_wh[0] // STRIDE] + (STRIDE - 1) / 2
    found = []
    for turn_deg in TURNS_DEG:
        copy_from_image = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), turn_deg, 1.0)
        copy = cv2.warpAffine(image, copy_from_image, padded_wh, borderMode=cv2.BORDER_REPLICATE)
        with torch.no_grad():
            output = _output(network, copy[None])[0].permute(1, 2, 0).numpy()
        pixels = cv2.transform(np.stack([u, v], axis=-1), cv2.invertAffineTransform(copy_from_image))
        shown = (output[..., 4] > 1) & ((pixels >= 0) & (pixels <= (width - 1, height - 1))).all(axis=-1)
        found.append(np.concatenate([pixels, output[..., :3], np.exp(output[..., 3:4])], axis=-1)[shown])
    return np.concatenate(found)


def _output(network: CoordinateNetwork, images: np.ndarray) -> torch.Tensor:
    pixels = torch.from_numpy(images).permute(0, 3, 1, 2).to(torch.float32) / 64 - 2
    return network(pixels)


def _loss(output: torch.Tensor, codes: torch.Tensor) -> torch.Tensor:
    """L1 for the coordinates; Laplace's likelihood for their error, which does not move them; entropy for surface."""
    truth, seen = codes.permute(0, 3, 1, 2).float() / FULL, codes[..., 0] != NOTHING
    surface = functional.binary_cross_entropy_with_logits(output[:, 4], seen.float())
    error = (output[:, :3] - truth).norm(dim=1)[seen]
    log_scale = output[:, 3][seen]
    sure = (error.detach() * torch.exp(-log_scale) + 3 * log_scale).mean()
    return 10 * error.mean() + 0.1 * sure + surface
