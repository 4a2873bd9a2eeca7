"""What registration has found of the film's frames: in memory, for the pose of the case's frame that it began with."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import bpy
import numpy as np

from ..class_registration import class_registration, listening
from ..pipeline.blender.registration.register_frames import CaseRegistrar
from ..pipeline.errors import InputError
from ..pipeline.registration.colour_sources import Candidate, candidate_of
from ..pipeline.registration.verdict import ACCEPTED, DOUBTFUL, REFUSED, Verdict
from ..state import another_frame
from ..state.another_frame import SeenFrame
from ..ui.background_operator import inputs_of
from ..video import session, shown_frame
from ..video.session import FilmSession

WORDS = {ACCEPTED: "found", DOUBTFUL: "doubtful", REFUSED: "lost"}


class FoundFrame(NamedTuple):
    """A frame's pose ``(4, 4)``, mm, if it has one, what to think of it, and what colouring needs if it is accepted."""

    verdict: Verdict
    cam_from_model: np.ndarray | None
    candidate: Candidate | None


@dataclass
class FoundFrames:
    """The frames of a film that are registered so far.

    Attributes
    ----------
    film, inputs
        The film, and the case at its pose as :func:`.inputs_of` says it.
    frames
        Position in the film's list of scores -> what was found.
    """

    film: FilmSession
    inputs: tuple[object, ...]
    frames: dict[int, FoundFrame] = field(default_factory=dict)

    def register(self, registrar: CaseRegistrar, progress: Callable[[float], None]) -> None:
        """Register all scored frames of the film; in any thread.

        Raises
        ------
        InputError
            The film has frames of another shape, or the case's frame shows too little texture.
        """
        positions = {score.index: at for at, score in enumerate(self.film.scores.frames)}
        with registrar.frames(self.film.path) as (_, frames):
            for frame in frames:
                if frame.number not in positions:
                    continue
                found = registrar.register(frame)
                candidate = candidate_of(frame.number, frame.image, found)
                self.frames[positions[frame.number]] = FoundFrame(found.verdict, found.cam_from_model, candidate)
                progress(len(self.frames) / len(positions))

    def candidates(self) -> list[Candidate]:
        """The accepted frames."""
        return [each.candidate for each in self.frames.values() if each.candidate is not None]

    def summary(self) -> str:
        """How many frames are found, doubtful and lost."""
        states = [each.verdict.state for each in self.frames.values()]
        return ", ".join(f"{states.count(state)} {word}" for state, word in WORDS.items())


latest: FoundFrames | None = None


def of(scene: bpy.types.Scene) -> FoundFrames | None:
    """What is found in the scene's film from the present pose of the case's frame."""
    if latest is None or latest.film is not session.of(scene):
        return None
    try:
        return latest if inputs_of(scene) == latest.inputs else None
    except InputError:
        return None


def text_of(verdict: Verdict) -> str:
    """A state in words, with the probability that the pose is right."""
    # 0.997 is not 100 %
    sure = "" if verdict.state == REFUSED else f", {int(100 * verdict.probability)} % sure"
    return f"{WORDS[verdict.state]}{sure}"


def _seen(scene: bpy.types.Scene) -> SeenFrame | None:
    found, film = of(scene), session.of(scene)
    if found is None or film is None or not shown_frame.is_shown(scene):
        return None
    name = f"frame {film.score.index} of {film.path.name}"
    if film.shown not in found.frames:
        return SeenFrame(name, "not registered", None)
    verdict, pose, _ = found.frames[film.shown]
    return SeenFrame(name, text_of(verdict), pose)


register, unregister = class_registration(__name__, listening(another_frame.finders, _seen))
