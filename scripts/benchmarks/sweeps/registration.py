"""Sweeps of the registration: all photographs, a film, bad frames, and where it ends.

Each yields trials. Random ones depend on the seed and their place alone.
"""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from oneframe.blender.sample.photograph import take_photographs
from oneframe.blender.sample.sample_case import FILM, FILM_POSES
from oneframe.case.frame import PosedFrame, UnreadFrame, load_posed_frame
from oneframe.poses.distributions import ReferencePose
from oneframe.sample.temporal_bone import sample_surface
from oneframe.transforms import inverse_rigid, transform_points

from ..alignment.registration_trials import Registration, RegistrationTrial, Scene, resized, spread
from .degradations import CLEAN, DEGRADATIONS, WRONG
from .refinement import blurred, faded

Trials = Iterator[RegistrationTrial]
OTHERS = 6
"""Images of other scenes that a source is shown."""
CONTRASTS, PAINT_PX, SIZES = (1.0, 0.3, 0.1, 0.05, 0.02), (0.0, 1.5, 3.0, 6.0, 12.0), (1.0, 0.5, 0.25, 0.125)
ZOOM_PERCENT, FILM_ZOOM = (-10.0, 5.0, 10.0), 1.12
TILTS_DEG, DIRECTIONS = (10.0, 20.0, 30.0, 45.0, 60.0, 75.0), 4


def photographs(scenes: Sequence[Scene], most: int | None) -> Trials:
    """Register every photograph to every other one, or to some of them."""
    for scene in scenes:
        for source in scene.sources(most):
            registration = Registration(source, "photographs")
            yield from registration.together(registration.trial(frame, CLEAN) for frame in source.photographs)


def zooms(scenes: Sequence[Scene], most: int | None) -> Trials:
    """Register all photographs of a source enlarged, and one of them; the amount is by how many percent."""
    for scene in scenes:
        for source in scene.sources(most):
            registration = Registration(source, "zoom")
            for percent in ZOOM_PERCENT:
                for kind, many in (("all zoomed", len(source.photographs)), ("one zoomed", 1)):
                    factors = [1 + percent / 100] * many + [1.0] * (len(source.photographs) - many)
                    trials = (
                        registration.trial(
                            frame, f"{kind} by {percent:g} %", 100 * (factor - 1), image=enlarged(frame, factor)
                        )
                        for frame, factor in zip(source.photographs, factors, strict=True)
                    )
                    yield from registration.together(trials)


def enlarged(frame: PosedFrame, factor: float) -> np.ndarray:
    """The image at a longer focal length."""
    matrix = factor * np.eye(2, 3)
    matrix[:, 2] = (1 - factor) * np.array([frame.camera.cx, frame.camera.cy])
    return cv2.warpAffine(
        frame.image, matrix, frame.camera.size_wh, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
    )


def film(scene: Scene, folder: Path, zoom: float = 1.0) -> Trials:
    """Track the sample's film; the kind is what spoils the frame. The focal length grows to ``zoom`` times its own."""
    registration = Registration(scene, "film" if zoom == 1 else "zoom")
    yield from registration.together(_film_trials(registration, folder, zoom))


def _film_trials(registration: Registration, folder: Path, zoom: float) -> Trials:
    scene = registration.scene
    listed = json.loads((folder / FILM_POSES).read_text())
    with registration.registrar.reader.opened(folder / FILM) as opened:
        for frame, entry in zip(opened.frames, listed, strict=False):
            pose = np.array(entry["cam_from_mesh"]) @ scene.loaded.surface.mesh_from_model
            image = frame.image.astype(np.float32) / 255
            posed = PosedFrame(image, frame.valid, registration.registrar.camera, pose, Path(f"{frame.number:03d}"))
            factor = 1 + (zoom - 1) * frame.number / (len(listed) - 1)
            kind = entry["disturbance"] or CLEAN if zoom == 1 else "slow zoom"
            image, percent = enlarged(posed, factor), 100 * (factor - 1)
            yield registration.trial(posed, kind, percent, image=image, tracked=frame.number)


def grid(scenes: Sequence[Scene], shown: Sequence[Scene], seed: int, few: tuple[int, int], *, quick: bool) -> Trials:
    """Spoil some photographs of each scene in every way, and show it some of all others; few sources and frames."""
    sources, frames = few
    for scene in scenes:
        cases = sum(other.name == scene.name for other in scenes)
        others = [frame for other in shown for frame in other.photographs if other is not scene]
        for number, source in enumerate(scene.sources(-(-sources // cases))):
            registration = Registration(source, "grid")
            for place in chosen(source, number, frames):
                frame = source.photographs[place]
                yield registration.trial(frame, CLEAN)
                yield registration.trial(frame, WRONG[0], image=frame.image[:, ::-1], shows=False)
                for kind, (name, how) in enumerate(DEGRADATIONS.items()):
                    for index, amount in enumerate(how.amounts):
                        if amount != how.clean and (index == 4 or not quick):
                            rng = np.random.default_rng([seed, number, place, kind, index])
                            spoilt = how.spoil(frame.image, amount, rng)
                            yield registration.trial(frame, name, amount, image=spoilt)
            for place in spread(len(others), OTHERS * sources)[number::sources]:
                image = fitted(others[place].image, registration.registrar.camera.shape_hw)
                placed = replace(source.loaded.frame, path=others[place].path)
                yield registration.trial(placed, WRONG[1], image=image, shows=False)


def chosen(source: Scene, number: int, frames: int) -> list[int]:
    """Places of some photographs, others for each source."""
    count = len(source.photographs)
    return sorted({(place + number) % count for place in spread(count, frames)})


def fitted(image: np.ndarray, shape_hw: tuple[int, int]) -> np.ndarray:
    """The image repeated by reflection, or cropped, to a shape."""
    more = [(0, max(0, shape_hw[axis] - image.shape[axis])) for axis in (0, 1)]
    return np.pad(image, (*more, (0, 0)), mode="symmetric")[: shape_hw[0], : shape_hw[1]]


def texture_and_size(scenes: Sequence[Scene], seed: int, few: tuple[int, int], *, quick: bool) -> Trials:
    """Source and frames lose contrast, with a sensor's noise, or fine paint, or are shrunk."""
    for scene in scenes:
        for source in scene.sources(few[0]):
            frames = [source.photographs[place] for place in spread(len(source.photographs), few[1])]
            for kind, amounts in (("contrast", CONTRASTS), ("paint", PAINT_PX), ("size", SIZES)):
                for amount in amounts[:: 3 if quick else 1]:
                    rng = np.random.default_rng(seed)
                    own, *others = (_poorer(frame, kind, amount, rng) for frame in (source.loaded.frame, *frames))
                    poorer = replace(source, loaded=replace(source.loaded, frames=(own,)))
                    registration = Registration(poorer, "limits")
                    at = shown_px(poorer, own) if kind == "size" else amount
                    yield from (registration.trial(frame, kind, at) for frame in others)


def _poorer(frame: PosedFrame, kind: str, amount: float, rng: np.random.Generator) -> PosedFrame:
    if kind == "size":
        return resized(frame, amount)
    return replace(frame, image=(faded if kind == "contrast" else blurred)(frame.image, amount, rng))


def small_objects(scenes: Sequence[Scene], most: int) -> Trials:
    """Register some photographs of small objects; the amount is the size of the object in the photograph."""
    for scene in scenes:
        registration = Registration(scene, "limits")
        for place in spread(len(scene.photographs), most):
            frame = scene.photographs[place]
            yield registration.trial(frame, "size", shown_px(scene, frame))


def shown_px(scene: Scene, frame: PosedFrame) -> float:
    """The longer side of what a frame may show of the surface."""
    points_cam = transform_points(frame.cam_from_model, scene.loaded.surface.mesh.vertices)
    pixels = np.clip(frame.camera.project(points_cam[points_cam[:, 2] > 0]), 0, frame.camera.size_wh)
    return float(np.ptp(pixels, axis=0).max())


def around(scene: Scene, out: Path, *, quick: bool) -> Scene:
    """The sample with photographs from ever further away around the source."""
    pivot = Registration(scene, "").registrar.pivot_model
    reference, turns = ReferencePose(scene.loaded.frame.cam_from_model, pivot), 2 * np.pi * np.arange(DIRECTIONS)
    poses = [
        reference.orbit((tilt * math.cos(turn), tilt * math.sin(turn)), 0.0, reference.distance_mm)
        for tilt in np.radians(TILTS_DEG[: 1 if quick else None])
        for turn in turns / DIRECTIONS
    ]
    return replace(scene, photographs=tuple(photographed(scene, poses, out)))


def overlap(scene: Scene) -> Trials:
    """Register what :func:`around` gives."""
    registration = Registration(scene, "limits")
    for frame in scene.photographs:
        yield registration.trial(frame, "overlap")


def photographed(scene: Scene, poses: Sequence[np.ndarray], out: Path) -> list[PosedFrame]:
    """Path trace the sample at some poses, ``cam_from_model``, into a folder."""
    camera, mesh_from_model = scene.loaded.frame.camera, scene.loaded.surface.mesh_from_model
    out.mkdir(parents=True)
    shots = [(pose @ inverse_rigid(mesh_from_model), out / f"{number:03d}.png") for number, pose in enumerate(poses)]
    return [
        load_posed_frame(UnreadFrame(path, camera, None, pose), mesh_from_model, name="sample")
        for path, (pose, _) in zip(take_photographs(sample_surface(), camera, shots), shots, strict=True)
    ]
