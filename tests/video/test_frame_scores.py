"""Scores of films whose good frames are known: a render of the sample case with faults laid over it."""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import pytest

from oneframe.images.pixel_values import to_uint8
from oneframe.sample.film import disturbance, disturbed, film_poses
from oneframe.video.film_reader import FilmFrame, FilmInfo
from oneframe.video.frame_scores import FilmScorer, FrameScore, best_frames
from tests.video.surgical_film import Event, clear_frames, random_events, surgical_film

FRAMES = 60
FILMS = {
    "noise": {"noise": 8.0, "drift_px": 0.5},
    "cut": {"cuts": (30,)},
    "resting instrument": {"resting_tool": (6, 41)},
}


def a_film(pictures, seed: int, settings: dict) -> tuple[list[np.ndarray], np.ndarray]:
    """Frames, and which of them are clear; at least a sixth of every scene."""
    rng = np.random.default_rng(seed)
    cuts = [0, *settings.get("cuts", ()), FRAMES]
    while True:
        events = random_events(rng, FRAMES)
        clear = clear_frames(events)
        clear[slice(*settings.get("resting_tool", (0, 0)))] = False
        if all(clear[begin:end].mean() > 1 / 6 for begin, end in pairwise(cuts)):
            return list(surgical_film(pictures, events, rng, **settings)), clear


def score_images(images: Iterable[np.ndarray]) -> tuple[FrameScore, ...]:
    """The scores of uint8 RGB images of one size, as if they were the small pictures of a film."""
    scorer = None
    for number, image in enumerate(images):
        if scorer is None:
            size_wh = (image.shape[1], image.shape[0])
            scorer = FilmScorer(FilmInfo(0, 25.0, size_wh, size_wh, True, 0.0))
        scorer.add(FilmFrame(number, number / 25, 0.0, image))
    return scorer.finished()


def test_the_best_frames_are_clear(sample_views):
    precision, found = {}, {}
    for seed, (name, settings) in enumerate(FILMS.items()):
        film, clear = a_film(sample_views, seed, settings)
        chosen = best_frames(score_images(film), 5)
        assert len(chosen) >= 3, name
        assert clear[chosen[0].index], name
        precision[name] = np.mean([clear[each.index] for each in chosen])
        found[name] = [(each.index, bool(clear[each.index])) for each in chosen]
    assert np.mean(list(precision.values())) >= 0.9, found
    assert min(precision.values()) >= 0.6, found


@pytest.fixture(scope="module")
def short_film(sample_views) -> list[np.ndarray]:
    kinds = ("clear", "tool", "blur", "clear", "dark", "blood", "clear", "glare", "clear")
    events = [Event(kind, 4 * number, 4 * number + 4) for number, kind in enumerate(kinds)]
    return list(surgical_film(sample_views[:1], events, np.random.default_rng(5)))


def test_what_is_reported_is_what_happened(short_film):
    scores = score_images(short_film)
    kinds = np.repeat(["clear", "tool", "blur", "clear", "dark", "blood", "clear", "glare", "clear"], 4)

    def of(kind: str, name: str) -> np.ndarray:
        return np.array([getattr(each, name) for each, its in zip(scores, kinds, strict=True) if its == kind])

    assert of("clear", "obstructed").max() < 0.005
    assert of("clear", "sharpness").min() > 0.85
    assert of("tool", "obstructed").min() > 0.01
    assert of("glare", "glare").min() > 0.005
    assert of("blur", "sharpness").max() < 0.75
    assert of("dark", "exposure").max() < -0.5


def test_a_camera_that_goes_around_the_tissue_covers_nothing(painted_bone):
    """Along the sample film's poses, and then disturbed as that film."""
    scores = score_images(
        disturbed(to_uint8(painted_bone.render(pose).rgb), number) for number, pose in [*enumerate(film_poses())][::3]
    )
    kinds = np.array([disturbance(3 * number) for number in range(len(scores))])
    covered, total = (np.array([getattr(each, name) for each in scores]) for name in ("obstructed", "total"))
    # the area under the curve: how often a pair is in the right order
    assert (covered[kinds == "instrument"][:, None] > covered[kinds == ""]).mean() > 0.95
    assert (total[kinds == ""][:, None] > total[(kinds == "instrument") | (kinds == "glare")]).mean() > 0.95
    assert np.median(covered[kinds == ""]) < 0.001


@pytest.mark.parametrize("kind", ["dark", "glove"])
def test_what_most_frames_show_is_not_what_is_right(sample_views, kind):
    """A third of the frames of a film is clear."""
    events = [Event(kind, 0, 16), Event("clear", 16, 28), Event(kind, 28, 36)]
    film = surgical_film(sample_views[:1], events, np.random.default_rng(9))
    chosen = best_frames(score_images(film), 3)
    assert [16 <= each.index < 28 for each in chosen] == [True] * 3
