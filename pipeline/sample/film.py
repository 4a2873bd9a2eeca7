"""A film of the sample: poses along a loop, and what lies over the surface or spoils the picture in some frames."""

import numpy as np

from .temporal_bone import microscope_pose

FRAMES = 60
DISTURBED = {"motion blur": range(16, 22), "instrument": range(30, 40), "glare": range(48, 56)}
"""What disturbs which frames; all others are clear."""

BLUR = 0.03
"""Length of the motion blur relative to the image's width."""
METAL = np.array([160.0, 155.0, 150.0])
SHAFT = 0.04
"""Half the width of the instrument, relative to the image's."""


def film_poses() -> list[np.ndarray]:
    """``cam_from_mesh`` ``(4, 4)``, mm, of each frame: a loop about the frame's pose."""
    turns = 2 * np.pi * np.arange(FRAMES) / FRAMES
    return [
        microscope_pose(
            20 + 12 * np.sin(turn), 328 + 45 * np.sin(2 * turn), 4 + 8 * np.sin(turn), 300 - 15 * np.sin(turn)
        )
        for turn in turns
    ]


def disturbance(number: int) -> str:
    """What disturbs a frame; empty if nothing does."""
    return next((name for name, numbers in DISTURBED.items() if number in numbers), "")


def disturbed(image: np.ndarray, number: int) -> np.ndarray:
    """A frame's photograph ``(H, W, 3)`` uint8 as the film shows it."""
    name, values = disturbance(number), image.astype(np.float32)
    height, width = image.shape[:2]
    v, u = np.mgrid[:height, :width] / width
    if name == "motion blur":
        steps = range(-round(BLUR * width / 2), round(BLUR * width / 2) + 1)
        values = np.mean([np.roll(values, step, axis=1) for step in steps], axis=0)
    elif name == "instrument":
        # a shaft from the right, whose tip moves through the cavity
        turn = (number - DISTURBED[name].start) / len(DISTURBED[name])
        tip, along = np.array([0.45 + 0.1 * turn, 0.35]), np.array([np.cos(0.4), np.sin(0.4 - 0.3 * turn)])
        along /= np.linalg.norm(along)
        reach = (u - tip[0]) * along[0] + (v - tip[1]) * along[1]
        across = (v - tip[1]) * along[0] - (u - tip[0]) * along[1]
        metal = METAL * (0.5 + 0.5 * np.sqrt(np.maximum(1 - (across / SHAFT) ** 2, 0)))[..., None]
        values = np.where(((np.abs(across) < SHAFT) & (reach > 0))[..., None], metal, values)
    elif name == "glare":
        spot = np.exp(-((u - 0.6) ** 2 + (v - 0.3) ** 2) / 0.02)
        values = values + 400 * spot[..., None]
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)
