"""Blender's real window on a display of its own, the extension installed in it from the zip, and the sample case."""

import ctypes
import json
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from pipeline.blender.sample.sample_case import write_sample_case
from pipeline.images.png import encode_png
from pipeline.sample.temporal_bone import sample_surface

HERE = Path(__file__).resolve().parent
PICTURES = HERE.parents[1] / "build" / "window"
SIZE = 1280, 800
WINDOW_FLAGS = ["--gpu-backend", "opengl", "--window-geometry", "0", "0", *map(str, SIZE)]
"""Where Blender renders in software, Vulkan draws lines wrongly."""


@pytest.fixture(scope="session")
def blender() -> str:
    """The Blender program."""
    if not (program := os.environ.get("BLENDER")):
        pytest.skip("the environment variable BLENDER names no Blender program")
    if not shutil.which("Xvfb"):
        pytest.skip("there is no Xvfb, which gives Blender a window without a screen")
    return program


@pytest.fixture(scope="session")
def resources(blender: str, extension_zip: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A user's configuration with the extension installed from the zip, not yet enabled."""
    folder = tmp_path_factory.mktemp("resources")
    command = [blender, "--command", "extension", "install-file", "-r", "user_default", extension_zip]
    ended = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=os.environ | {"BLENDER_USER_RESOURCES": str(folder)},
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert (folder / "extensions" / "user_default" / "oneframe").is_dir(), ended.stdout + ended.stderr
    return folder


@pytest.fixture(scope="session")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The case file of the built-in sample, without the photographs that are kept aside."""
    folder = tmp_path_factory.mktemp("sample")
    *_, case = write_sample_case(folder, sample_surface(), held_out=False)
    return case


@pytest.fixture
def run_in_window(blender: str) -> Callable[..., tuple[int | str, str]]:
    """Runs a command, given the environment variables that it needs besides, on a display of its own."""

    def run(command: list, timeout_s: float, **environment: object) -> tuple[int | str, str]:
        settings = {name: str(value) for name, value in environment.items()}
        with _display(SIZE) as name:
            return _run_group(list(map(str, command)), os.environ | settings | {"DISPLAY": name}, timeout_s)

    return run


@pytest.fixture
def play(blender: str, resources: Path, sample: Path, tmp_path: Path, run_in_window) -> Callable[[Path, float], dict]:
    """Plays a scenario file in a Blender of its own; gives the facts that it found, fails if it fails."""

    def run(scenario: Path, timeout_s: float) -> dict:
        own = tmp_path / "resources"
        shutil.copytree(resources, own, copy_function=_copy)
        case = shutil.copytree(sample.parent, tmp_path / "case") / sample.name
        folders = {name: tmp_path / name for name in ("folder", "pictures", "temporary")}
        for folder in folders.values():
            folder.mkdir()
        result, settings = tmp_path / "result.json", tmp_path / "settings.json"
        messages = {"scenario": scenario, "case": case, "result": result, "timeout_s": timeout_s, **folders}
        settings.write_text(json.dumps(messages, default=str))
        flags = ["--factory-startup", "--enable-event-simulate", "-noaudio", *WINDOW_FLAGS]
        command = [blender, *flags, "--python-exit-code", "1", "-P", HERE / "driver.py", "--", settings]
        try:
            status, output = run_in_window(
                command, timeout_s + 10, BLENDER_USER_RESOURCES=own, TMPDIR=folders["temporary"]
            )
        finally:
            _keep_pictures(folders["pictures"], PICTURES / scenario.stem.removeprefix("scenario_"))
        assert result.exists(), f"Blender ended with {status}:\n{output}"
        found = json.loads(result.read_text())
        assert found["passed"], f"{found.get('error')}\nwhat Blender wrote:\n{output}"
        assert status == 0, f"Blender ended with {status}:\n{output}"
        assert "Policy violation" not in output
        return found["facts"]

    return run


@contextmanager
def _display(size: tuple[int, int]) -> Iterator[str]:
    """A display in memory; its name."""
    reading, writing = os.pipe()
    screen = f"{size[0]}x{size[1]}x24"
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writing), "-screen", "0", screen, "-nolisten", "tcp"],
        pass_fds=[writing],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        preexec_fn=_end_with_parent,
    )
    try:
        os.close(writing)
        with open(reading, encoding="ascii") as messages:
            number = messages.readline().strip()
        assert number, "Xvfb has not started"
        yield f":{number}"
    finally:
        server.kill()
        server.wait()


def _end_with_parent() -> None:
    """In a child: end when the tests are killed and can no longer end it."""
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


def _copy(source: str, target: str) -> None:
    """Wheels, which are large, as links; Blender's own records as copies, since it writes into them."""
    if source.endswith(".whl"):
        with suppress(OSError):
            os.link(source, target)
            return
    shutil.copy2(source, target)


def _run_group(command: list[str], environment: dict[str, str], timeout_s: float) -> tuple[int | str, str]:
    """Exit status and all output of a command; killed with all its children when the time is up."""
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen(
            command,
            stdout=output,
            stderr=output,
            env=environment,
            start_new_session=True,
            preexec_fn=_end_with_parent,
        )
        try:
            status: int | str = process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            status = f"nothing, after {timeout_s:g} s"
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        output.seek(0)
        return status, output.read()


def _keep_pictures(folder: Path, kept: Path) -> None:
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir(parents=True)
    for path in sorted(folder.glob("*.npy")):
        (kept / f"{path.stem}.png").write_bytes(encode_png(np.load(path)))
