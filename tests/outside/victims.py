"""Readers of files in a process of their own, one file after another; a process that dies or hangs is replaced.

An answer is a value, a sentence (an InputError), or anything else, which is a defect.
"""

import multiprocessing
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from pathlib import Path

import numpy as np

from oneframe.camera.intrinsics_file import read_camera
from oneframe.camera.plausibility import fit_of
from oneframe.case.case_file import read_case
from oneframe.case.case_writer import case_text
from oneframe.case.landmark_file import read_landmarks
from oneframe.errors import InputError
from oneframe.files.content import reading
from oneframe.images.image_check import check_image_file
from oneframe.poses.pose_file import read_pose, read_poses
from oneframe.surface.mesh_reader import read_mesh
from oneframe.volume.drill.drill_plan import read_drill_plan
from oneframe.volume.reading.label_map import read_labels
from oneframe.volume.reading.volume_reader import read_volume


class _Case:
    """As much of a case as the reader of photographs needs."""

    mm_per_unit, camera = 1000.0, None


def _photographs(path: Path) -> object:
    from oneframe.blender.case.load_case import read_photographs

    return read_photographs(path, _Case())  # type: ignore[arg-type]


def _camera(path: Path) -> object:
    found = read_camera(path)
    fit = fit_of(found, (64, 48))
    return fit, found.distortion_for(fit.camera)


def _case(path: Path) -> object:
    """Read it, look for its files, and write it again."""
    case = read_case(path)
    case_text(path, case)
    for file in case.input_files().values():
        with reading(file, "a file of the case", path.name):
            pass
    return case


def _image(path: Path) -> object:
    from oneframe.blender.bridge.image import read_image

    return read_image(path, path.name)


def _video(path: Path) -> object:
    from oneframe.video.frame_reader import read_video_frame, video_info

    return read_video_frame(path, video_info(path).frames - 1)


READERS: dict[str, Callable[[Path], object]] = {
    "camera": _camera,
    "pose": lambda path: read_pose(path, mm_per_unit=1000.0),
    "poses": lambda path: read_poses(path, mesh_from_model=np.eye(4), mm_per_unit=1000.0),
    "landmarks": lambda path: read_landmarks(path, mm_per_unit=1000.0),
    "case": _case,
    "photographs": _photographs,
    "mesh": lambda path: read_mesh(path),
    "image header": lambda path: check_image_file(path, path.name),
    "image": _image,
    "video": _video,
    "volume": lambda path: read_volume(path),
    "slice": lambda path: read_volume(path.parent),
    "labels": lambda path: read_labels(path),
    "drill plan": lambda path: read_drill_plan(path),
}

MEGABYTES = 1024.0
"""What opening a file may take at most."""
PATIENCE_S = 120.0
"""Time after which a process is stopped: it starts Blender, and the computer may be busy."""

Answer = tuple[str, str, float]
"""Kind, text and largest memory in MB."""


class Victims:
    """One process at a time, started when it is needed."""

    def __enter__(self) -> "Victims":
        self._process: ProcessPoolExecutor | None = None
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def opened(self, reader: str, path: Path) -> Answer:
        """What a reader makes of a file."""
        if self._process is None:
            self._process = ProcessPoolExecutor(
                1, multiprocessing.get_context("spawn"), initializer=_forget_folders_of_blender
            )
        try:
            return self._process.submit(_answer, reader, path).result(PATIENCE_S)
        except (BrokenExecutor, TimeoutError) as error:
            self._end()
            return "dead", repr(error), 0.0

    def _end(self) -> None:
        if self._process is not None:
            for process in list(self._process._processes.values()):
                process.kill()
            self._process.shutdown()
            self._process = None


def faults_of(answers: Iterable[tuple[str, str, Answer]]) -> list[str]:
    """What is wrong with answers, given with a name and that of the file: nothing, if all are as they should be."""
    faults = []
    for name, file, (kind, text, megabytes) in answers:
        if kind not in ("value", "sentence"):
            faults.append(f"{name}: {kind}: {text}")
        elif megabytes > MEGABYTES:
            faults.append(f"{name}: {megabytes:.0f} MB")
        elif kind == "sentence" and (file not in text or len(text) > 1500):
            faults.append(f"{name}: expected a sentence that names {file}, found {text[:300]!r}")
    return faults


def _forget_folders_of_blender() -> None:
    """Those that this process has inherited if ours has Blender: its module is another one from there."""
    sys.path[:] = [path for path in sys.path if f"{os.sep}bpy{os.sep}" not in path]


def _answer(reader: str, path: Path) -> Answer:
    # numbers that overflow would warn on the terminal
    warnings.simplefilter("error")
    warnings.filterwarnings("ignore", category=DeprecationWarning)
    Path("/proc/self/clear_refs").write_text("5")
    kind, text = "value", ""
    try:
        READERS[reader](path)
    except InputError as error:
        kind, text = "sentence", str(error)
    except BaseException:
        kind, text = "defect", traceback.format_exc()[-2000:]
    lines = Path("/proc/self/status").read_text().splitlines()
    peak_kb = next(line for line in lines if line.startswith("VmHWM")).split()[1]
    return kind, text, int(peak_kb) / 1024
