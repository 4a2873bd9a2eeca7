"""A Slurm for the tests of this folder, and the program that they submit."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cluster.slurm.slurm_on_this_machine import CannotRun, Slurm

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="session")
def slurm() -> Iterator[Slurm]:
    """A real Slurm; where it cannot be had, the test is skipped with the reason."""
    try:
        one = Slurm()
    except CannotRun as error:
        pytest.skip(f"no Slurm: {error}")
    yield one
    one.stop()


@pytest.fixture(scope="session")
def program_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the command ``oneframe`` of this checkout and this Python, for the ``PATH``."""
    folder = tmp_path_factory.mktemp("bin")
    program = folder / "oneframe"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m oneframe.commands "$@"\n')
    program.chmod(0o755)
    return folder


@pytest.fixture
def submitting(slurm: Slurm, program_folder: Path) -> Iterator[dict[str, str]]:
    """Environment variables of a machine that submits to Slurm and has ``oneframe``; the queue is empty afterwards."""
    # a Blender program, which other tests are for, would take the place of oneframe
    yield slurm.environment | {"PATH": f"{program_folder}:{os.environ['PATH']}", "BLENDER": ""}
    slurm.cancel_all()
