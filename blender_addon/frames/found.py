"""What registration has found of the film's frames: in memory, for the pose of the case's frame that it began with."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import bpy

from ..class_registration import class_registration, listening
from ..pipeline.blender.registration.register_frames import CaseRegistrar
from ..pipeline.errors import InputError
from ..pipeline.registration.colour_sources import Candidate, Candidates
from ..pipeline.registration.film_change import FilmAgreement, FilmChange
from ..pipeline.registration.register import RegisteredFrame, judged_together
from ..pipeline.registration.verdict import ACCEPTED, DOUBTFUL, REFUSED, Verdict
from ..state import another_frame, from_scene
from ..state.another_frame import SeenFrame
from ..ui.background_operator import inputs_of
from ..video import session, shown_frame
from ..video.session import FilmSession

WORDS = {ACCEPTED: "found", DOUBTFUL: "doubtful", REFUSED: "lost"}


@dataclass
class FoundFrames:
    """The frames of a film that are registered so far.

    Attributes
    ----------
    film, inputs
        The film, and the case at its pose as :func:`.inputs_of` says it.
    frames
        Position in the film's list of scores -> what was found, without the fit.
    candidates
        Frames that may colour the surface, of which :meth:`colouring` takes those that still may.
    alone
        The frames as each was found alone; how they are judged together is in ``frames``.
    change
        What the film no longer shows as the case's frame does.
    """

    film: FilmSession
    inputs: tuple[object, ...]
    frames: dict[int, RegisteredFrame] = field(default_factory=dict)
    candidates: Candidates = field(default_factory=Candidates)
    alone: dict[int, RegisteredFrame] = field(default_factory=dict)
    change: FilmChange | None = None

    def register(self, registrar: CaseRegistrar, progress: Callable[[float], None]) -> None:
        """Register all scored frames of the film; in any thread.

        Raises
        ------
        InputError
            The film has frames of another shape, or the case's frame shows too little texture.
        """
        positions = {score.index: at for at, score in enumerate(self.film.scores.frames)}
        agreement = FilmAgreement(registrar.camera, registrar.cam_from_model, registrar.pivot_model)
        with registrar.frames(self.film.path) as (_, frames):
            for frame in frames:
                if frame.number not in positions:
                    continue
                found = registrar.register(frame)
                self.candidates.add(frame.number, frame.image, frame.valid, found)
                if found.fit is not None and found.verdict.state == ACCEPTED:
                    agreement.add(frame.number, found.fit)
                self.alone[positions[frame.number]] = replace(found, fit=None)
                self.frames = dict(zip(self.alone, judged_together(list(self.alone.values())), strict=True))
                progress(len(self.frames) / len(positions))
        self.change = agreement.change()

    def colouring(self) -> list[Candidate]:
        """The frames that are accepted, and show the surface as the case's frame does."""
        numbers = {
            self.film.scores.frames[at].index for at, each in self.frames.items() if each.verdict.state == ACCEPTED
        }
        return [
            each
            for each in self.candidates.frames
            if each.number in numbers and (self.change is None or each.number < self.change.since)
        ]

    def summary(self) -> str:
        """How many frames are found, doubtful and lost."""
        states = [each.verdict.state for each in self.frames.values()]
        counts = ", ".join(f"{states.count(state)} {word}" for state, word in WORDS.items())
        return counts if self.change is None else f"{counts}; {self.change.words()}"


latest: FoundFrames | None = None


def of(scene: bpy.types.Scene) -> FoundFrames | None:
    """What is found in the scene's film from the present pose of the case's frame."""
    if latest is None or latest.film is not session.of(scene):
        return None
    try:
        return latest if inputs_of(scene) == latest.inputs else None
    except InputError:
        return None


def frame_at(scene: bpy.types.Scene, at: int) -> RegisteredFrame | None:
    """What is found in the frame at a position in the film's list of scores; ``None`` if it is not registered."""
    registered = of(scene)
    return None if registered is None else registered.frames.get(at)


def text_of(verdict: Verdict) -> str:
    """A state in words, with the probability that the pose is right."""
    # 0.997 is not 100 %
    sure = "" if verdict.state == REFUSED else f", {int(100 * verdict.probability)} % sure"
    return f"{WORDS[verdict.state]}{sure}"


def _seen(scene: bpy.types.Scene) -> SeenFrame | None:
    film = session.of(scene)
    # until the case has a frame, it is the film's
    if film is None or not shown_frame.is_shown(scene) or not scene.oneframe.frame_path:
        return None
    if from_scene.video(scene) == (film.path.name, film.score.index):
        return None
    name, frame = f"frame {film.score.index} of {film.path.name}", frame_at(scene, film.shown)
    if frame is None:
        return SeenFrame(name, "not registered", None)
    return SeenFrame(name, text_of(frame.verdict), frame.cam_from_model)


register, unregister = class_registration(__name__, listening(another_frame.finders, _seen))
