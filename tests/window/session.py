"""Plays one scenario in Blender's real window, on a separate display, with the extension installed from its zip.

Used by the fixtures of these tests.
"""

import ctypes
import json
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from oneframe.images.png import encode_png
from tests.window import x11

DRIVER = Path(__file__).resolve().parent / "driver.py"
PACKAGE = "bl_ext.user_default.oneframe"
SIZE = (1280, 800) if os.environ.get("ONEFRAME_SCREENSHOTS") else (800, 500)
"""Of the window, pixels: most of the time goes into drawing them in software."""


def window_flags(size_wh: tuple[int, int] = SIZE) -> list[str]:
    """Blender's flags for a window that fills the display; OpenGL, since Vulkan in software draws lines wrongly."""
    return ["--gpu-backend", "opengl", "--window-geometry", "0", "0", *map(str, size_wh)]


def install_extension(blender: str, extension_zip: Path, resources: Path) -> None:
    """Install the extension into a separate user configuration; enabled once, it has unpacked its wheels."""
    install = ["--command", "extension", "install-file", "-r", "user_default", extension_zip]
    enable = f"import bpy; bpy.ops.preferences.addon_enable(module={PACKAGE!r})"
    for arguments in (install, ["-b", "--factory-startup", "--python-exit-code", "1", "--python-expr", enable]):
        ended = subprocess.run(
            [blender, *arguments],
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | {"BLENDER_USER_RESOURCES": str(resources)},
        )
        assert ended.returncode == 0, ended.stdout + ended.stderr
    assert (resources / "extensions" / "user_default" / "oneframe").is_dir(), ended.stdout + ended.stderr


def play_scenario(
    blender: str,
    scenario: Path,
    *,
    resources: Path,
    case: Path,
    folder: Path,
    pictures: Path,
    timeout_s: float,
    size_wh: tuple[int, int] = SIZE,
) -> dict:
    """Play a scenario file, with a generator function ``scenario(user)``, in a separate Blender; returns its facts.

    ``resources``, a configuration with the extension installed, and the folder of ``case``, which the user opens, are
    copied into ``folder``, which is empty at first. ``pictures`` gets those of the window, as PNG. Raises
    AssertionError if the scenario fails, or Blender ends with an error or after ``timeout_s``.
    """
    own = folder / "resources"
    shutil.copytree(resources, own, copy_function=_copy)
    case = shutil.copytree(case.parent, folder / "case") / case.name
    folders = {name: folder / name for name in ("folder", "pictures", "temporary")}
    for each in folders.values():
        each.mkdir()
    result, settings = folder / "result.json", folder / "settings.json"
    messages = {"scenario": scenario, "case": case, "result": result, "timeout_s": timeout_s, **folders}
    settings.write_text(json.dumps(messages, default=str))
    flags = ["--factory-startup", "--enable-event-simulate", "-noaudio", *window_flags(size_wh)]
    command = [blender, *flags, "--python-exit-code", "1", "-P", DRIVER, "--", settings]
    environment = {"BLENDER_USER_RESOURCES": own, "TMPDIR": folders["temporary"]}
    try:
        status, output = run_in_window(command, timeout_s + 10, size_wh, **environment)
    finally:
        _keep_pictures(folders["pictures"], pictures)
    assert result.exists(), f"Blender ended with {status}:\n{output}"
    found = json.loads(result.read_text())
    assert found["passed"], f"{found.get('error')}\noutput of Blender:\n{output}"
    assert status == 0, f"Blender ended with {status}:\n{output}"
    # Blender prints what drawing and timers raise, and goes on
    assert "Policy violation" not in output
    assert "Traceback" not in output, output
    return found["facts"]


def run_in_window(
    command: list, timeout_s: float, size_wh: tuple[int, int] = SIZE, **environment: object
) -> tuple[int | str, str]:
    """Run a command on a separate display with additional environment variables; returns exit status and output."""
    settings = {name: str(value) for name, value in environment.items()}
    with _display(size_wh) as name:
        return _run_group(list(map(str, command)), os.environ | settings | {"DISPLAY": name}, timeout_s)


@contextmanager
def _display(size: tuple[int, int]) -> Iterator[str]:
    """Start a display in memory; yields its name."""
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
        with x11.with_crosses(f":{number}"):
            yield f":{number}"
    finally:
        server.kill()
        server.wait()


def _end_with_parent() -> None:
    """In a child process: end with the parent, which cannot end it once killed."""
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


def _copy(source: str, target: str) -> None:
    """Link wheels and what is unpacked of them, which are large; copy all else: Blender writes to its records."""
    if source.endswith(".whl") or "/.local/" in source:
        with suppress(OSError):
            os.link(source, target)
            return
    shutil.copy2(source, target)


def _run_group(command: list[str], environment: dict[str, str], timeout_s: float) -> tuple[int | str, str]:
    """Run a command and return exit status and output; kill it with its children after the timeout."""
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
            status = f"no exit status after {timeout_s:g} s"
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
