"""Every file that means harm ends in a value or in a sentence: no traceback, no crash, 5 s, 1 GB at most."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.outside.binary_bombs import binaries, pictures
from tests.outside.bombs import Bomb, texts, values
from tests.outside.victims import Victims, faults_of


def sample(bombs: Sequence[Bomb], number: int, long_form: bool) -> list[Bomb]:
    """All of them, or a number of them that is always the same."""
    if long_form:
        return list(bombs)
    return [bombs[index] for index in np.random.default_rng(16).permutation(len(bombs))[:number]]


def faults(bombs: Sequence[Bomb], folder: Path) -> list[str]:
    answers = []
    with Victims() as victims:
        for number, bomb in enumerate(bombs):
            place = folder / str(number)
            place.mkdir()
            try:
                bomb.write(place / bomb.file)
            except PermissionError:
                continue
            answers.append((bomb.name, bomb.file, victims.opened(bomb.reader, place / bomb.file)))
            shutil.rmtree(place)
    return faults_of(answers)


ALL: dict[str, tuple[Callable[[], list[Bomb]], int]] = {
    "texts": (lambda: list(texts()), 50),
    "values": (lambda: list(values()), 40),
    "binaries": (lambda: list(binaries()), 40),
    "headers of images": (lambda: list(pictures("image header")), 30),
}


@pytest.mark.parametrize("kind", ALL)
def test_bombs_end_in_a_value_or_a_sentence(tmp_path, long_form, kind):
    bombs, number = ALL[kind]
    assert faults(sample(bombs(), number, long_form), tmp_path) == []
