"""Films of surgery with known faults: a real picture, over which instruments, hands, blood and light are laid."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

KINDS = ("tool", "hand", "glove", "blur", "motion", "glare", "blood", "dark", "bright")
SKIN, GLOVE, METAL = (205, 140, 120), (120, 160, 190), (160, 155, 150)


@dataclass(frozen=True)
class Event:
    """What happens in the frames ``begin`` ... ``end`` - 1."""

    kind: str
    begin: int
    end: int


def random_events(rng: np.random.Generator, frames: int) -> list[Event]:
    """Events of 8 to 25 frames, a third of them clear."""
    events, at = [], 0
    while at < frames:
        kind = str(rng.choice(["clear"] * 4 + list(KINDS)))
        end = min(at + int(rng.integers(8, 26)), frames)
        events.append(Event(kind, at, end))
        at = end
    return events


def clear_frames(events: Sequence[Event]) -> np.ndarray:
    """Bool for each frame."""
    return np.concatenate([np.full(event.end - event.begin, event.kind == "clear") for event in events])


def surgical_film(
    pictures: Sequence[np.ndarray],
    events: Sequence[Event],
    rng: np.random.Generator,
    *,
    cuts: Sequence[int] = (),
    noise: float = 3.0,
    drift_px: float = 0.25,
    resting_tool: tuple[int, int] | None = None,
) -> Iterator[np.ndarray]:
    """Frames, (H, W, 3) uint8 RGB.

    At each of ``cuts`` the next picture follows. ``resting_tool``: frames in which an instrument lies in the view
    without moving.
    """
    height, width = pictures[0].shape[:2]
    size = np.array([width, height])
    total = events[-1].end
    drift = np.cumsum(rng.normal(0, drift_px, (total, 2)), axis=0)
    shapes = {event: _Shape.drawn(rng, size) for event in events}
    resting = _Shape.drawn(rng, size)
    for event in events:
        shape = shapes[event]
        for number in range(event.begin, event.end):
            picture = pictures[sum(number >= cut for cut in cuts) % len(pictures)]
            to_frame = np.column_stack([np.eye(2), drift[number]])
            frame = cv2.warpAffine(picture, to_frame, (width, height), borderMode=cv2.BORDER_REFLECT).astype(np.float32)
            if resting_tool and resting_tool[0] <= number < resting_tool[1]:
                frame = resting.metal(frame, drift[number] * 0)
            frame = _with(frame, event, number, shape, rng)
            yield np.clip(np.rint(frame + rng.normal(0, noise, frame.shape)), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class _Shape:
    """Where and how large an event is."""

    centre: np.ndarray
    angle: float
    width: float
    strength: float
    size: np.ndarray

    @classmethod
    def drawn(cls, rng: np.random.Generator, size: np.ndarray) -> "_Shape":
        centre = size / 2 + rng.uniform(-0.1, 0.1, 2) * size[0]
        return cls(centre, rng.uniform(0, 2 * np.pi), size[0] * rng.uniform(0.03, 0.065), rng.uniform(0.5, 1), size)

    def _along_across(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        v, u = np.mgrid[: self.size[1], : self.size[0]]
        direction = np.array([np.cos(self.angle), np.sin(self.angle)])
        u, v = u - at[0], v - at[1]
        return u * direction[0] + v * direction[1], u * -direction[1] + v * direction[0]

    def bar(self, frame: np.ndarray, at: np.ndarray, width: float, colour: Sequence[int], gloss: float) -> np.ndarray:
        """A bar from the edge of the frame to near its centre, shaded as a cylinder."""
        along, across = self._along_across(at)
        mask = cv2.GaussianBlur(((along > 0) & (np.abs(across) < width / 2)).astype(np.float32), (0, 0), 1.5)[..., None]
        shade = (0.75 + 0.25 * np.sqrt(np.clip(1 - (2 * across / width) ** 2, 0, 1)))[..., None]
        light = gloss * np.exp(-(((across - width / 5) / (width / 8)) ** 2))[..., None]
        return frame * (1 - mask) + (np.array(colour) * shade + light) * mask

    def metal(self, frame: np.ndarray, shift: np.ndarray) -> np.ndarray:
        return self.bar(frame, self.centre + shift, self.width, METAL, 90)


def _with(frame: np.ndarray, event: Event, number: int, shape: _Shape, rng: np.random.Generator) -> np.ndarray:
    height, width = frame.shape[:2]
    shake = rng.normal(0, width * 0.01, 2)
    match event.kind:
        case "tool":
            return shape.metal(frame, shake)
        case "hand":
            return shape.bar(frame, shape.centre + shake, 3 * shape.width, SKIN, 0)
        case "glove":
            return shape.bar(frame, shape.centre + shake, 3 * shape.width, GLOVE, 15)
        case "blur":
            return cv2.GaussianBlur(frame, (0, 0), width / 640 * (1.0 + 2.5 * shape.strength))
        case "motion":
            length = int(width / 640 * 21) | 1
            return cv2.filter2D(frame, -1, np.full((1, length), 1 / length, np.float32))
        case "glare":
            v, u = np.mgrid[:height, :width]
            distance = ((u - shape.centre[0]) / (0.09 * width)) ** 2 + ((v - shape.centre[1]) / (0.07 * width)) ** 2
            return frame + shape.strength * 255 * np.exp(-distance)[..., None]
        case "blood":
            v, u = np.mgrid[:height, :width]
            rise = height * (1 - 0.5 * shape.strength) - 0.1 * width * np.sin(u / (0.1 * width))
            mask = 0.9 * shape.strength * np.clip((v - rise) / 15, 0, 1)[..., None]
            return frame * (1 - mask) + np.array([130, 20, 25]) * mask
        case "dark":
            return frame * (0.6 - 0.3 * shape.strength)
        case "bright":
            return frame * (1.35 + 0.5 * shape.strength)
    return frame


def write_film(path: Path, images: Iterable[np.ndarray], fourcc: str = "FFV1", fps: float = 25.0) -> Path:
    """Write RGB images of one size as a video, without loss by default; returns its path."""
    writer = None
    for image in images:
        if writer is None:
            size_wh = image.shape[1::-1]
            writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*fourcc), fps, size_wh)
        writer.write(np.ascontiguousarray(image[..., ::-1]))
    writer.release()
    return path
