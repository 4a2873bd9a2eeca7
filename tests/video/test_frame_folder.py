"""What the selection writes: exact frames, masks that cover what lies in front of the tissue, a table of all frames."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.commands.__main__ import dispatch
from oneframe.errors import InputError
from oneframe.video.frame_folder import write_frame, write_frames, write_frames_only
from oneframe.video.frame_mask import single_mask
from oneframe.video.frame_scores import FilmScores, best_frames, score_frames
from tests.video.conftest import SIZE_WH
from tests.video.surgical_film import Event, surgical_film, write_film

pytestmark = pytest.mark.usefixtures("decoded_here")

KINDS, EACH = ("clear", "tool", "clear", "glove", "blur", "clear"), 6
"""What happens in a film, and for how many frames."""


@pytest.fixture(scope="module")
def film(sample_views, tmp_path_factory) -> tuple[Path, list[np.ndarray], list[np.ndarray]]:
    """A film without loss, its frames, and its frames as they would be without faults."""
    events = [Event(kind, EACH * number, EACH * number + EACH) for number, kind in enumerate(KINDS)]
    clear = [Event("clear", 0, events[-1].end)]
    faulty, faultless = (
        list(surgical_film(sample_views[:1], each, np.random.default_rng(3), noise=0, drift_px=0))
        for each in (events, clear)
    )  # fmt: skip
    path = tmp_path_factory.mktemp("film") / "film.mkv"
    return write_film(path, faulty), faulty, faultless


@pytest.fixture(scope="module")
def scores(film) -> FilmScores:
    return score_frames(film[0])


def test_chosen_frames_are_exact_and_their_table_has_all(film, scores, tmp_path):
    path, images, _ = film
    chosen = best_frames(scores.frames, 3)
    written = write_frames(path, tmp_path / "out", scores, chosen)
    assert [each.score for each in written] == list(chosen)
    for each in written:
        assert KINDS[each.score.index // EACH] == "clear"
        assert np.array_equal(cv2.imread(str(each.image))[..., ::-1], images[each.score.index])
        masked = cv2.imread(str(each.masked), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(masked[..., 2::-1], images[each.score.index])
        assert set(np.unique(masked[..., 3])) <= {0, 255}
        assert (masked[..., 3] > 0).mean() == pytest.approx(each.tissue)
        assert each.tissue > 0.85
    rows = list(csv.DictReader((tmp_path / "out" / "scores.csv").read_text().splitlines()))
    assert [int(row["frame"]) for row in rows] == list(range(len(images)))
    assert [int(row["frame"]) for row in rows if row["chosen"] == "1"] == [chosen[0].index]
    # again: the same files; another image of that name stays
    write_frames(path, tmp_path / "out", scores, chosen)
    cv2.imwrite(str(written[0].image), images[0] // 2)
    with pytest.raises(InputError, match="expected no such file, or one with this frame, found another image"):
        write_frames(path, tmp_path / "out", scores, chosen)
    # in the order of the film, decoded once: the same
    (tmp_path / "only").mkdir()
    some = [scores.frames[number] for number in (3, 4, 20, len(images) - 1)]
    for score, file in zip(some, write_frames_only(path, tmp_path / "only", some), strict=True):
        assert np.array_equal(cv2.imread(str(file))[..., ::-1], images[score.index])
    assert file.read_bytes() == write_frame(path, file.parent, scores, score).read_bytes()


@pytest.mark.parametrize(("kind", "known"), [("tool", "film"), ("glove", "film"), ("glove", "frame alone")])
def test_the_mask_covers_what_lies_in_front(film, scores, tmp_path, kind, known):
    path, images, faultless = film
    index = EACH * KINDS.index(kind) + EACH // 2
    if known == "film":
        (written,) = write_frames(path, tmp_path / "out", scores, [scores.frames[index]])
        hidden = cv2.imread(str(written.masked), cv2.IMREAD_UNCHANGED)[..., 3] == 0
    else:
        hidden = ~single_mask(images[index])
    foreign = np.abs(images[index].astype(int) - faultless[index]).max(axis=2) > 12
    burnt = cv2.dilate((images[index].min(axis=2) >= 245).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    assert (hidden & foreign).sum() > 0.9 * foreign.sum()
    assert (hidden & ~foreign & ~burnt).sum() < 0.03 * foreign.size


def test_the_black_around_the_view_is_masked(film, tmp_path):
    _, images, _ = film
    across, down = np.meshgrid(np.arange(SIZE_WH[0]) - 122.4, np.arange(SIZE_WH[1]) - 88.8)
    inside = np.hypot(across, down) < 84.5
    # tissue at its edge may be nearly as dark
    dark = inside & (across > 50) & (np.abs(down) < 20)
    path = write_film(
        tmp_path / "film.mkv", [(image * np.where(dark, 0.05, inside)[..., None]).astype(np.uint8) for image in images]
    )
    scores = score_frames(path)
    (written,) = write_frames(path, tmp_path / "out", scores, best_frames(scores.frames, 1))
    alpha = cv2.imread(str(written.masked), cv2.IMREAD_UNCHANGED)[..., 3]
    assert not alpha[~inside].any()
    for part, least in ((inside, 0.85), (dark, 0.95)):
        assert (alpha[part & (np.hypot(across, down) < 81.5)] > 0).mean() > least


def test_of_a_film_that_is_cut_off_the_command_takes_what_it_has(film, tmp_path, run_oneframe):
    short, out = tmp_path / "short.mkv", tmp_path / "out"
    short.write_bytes(film[0].read_bytes()[: film[0].stat().st_size // 2])
    ended = run_oneframe("frames", short, "--out", out, "--count", 1)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "cut off" in ended.stdout
    assert "1. short_frame_0000" in ended.stdout
    assert len(list(out.glob("short_frame_*.png"))) == 2
    assert {"contact_sheet.png", "scores.csv"} < {file.name for file in out.iterdir()}
    assert not list(tmp_path.glob("**/.partial*"))


def test_a_film_that_shows_nothing_gives_its_scores_and_says_so(tmp_path):
    path = write_film(tmp_path / "black.mkv", [np.zeros((120, 160, 3), np.uint8)] * 12)
    with pytest.raises(InputError, match=r"black\.mkv: expected a frame that shows something sharply, found none; see"):
        dispatch(["frames", str(path), "--out", str(tmp_path / "out")])
    assert len((tmp_path / "out" / "scores.csv").read_text().splitlines()) == 13
