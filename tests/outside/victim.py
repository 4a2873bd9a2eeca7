"""A process that opens files: one request a line (reader and path, as JSON), one answer a line.

An answer is a value, a sentence (an InputError), or anything else, which is a defect.
"""

import json
import sys
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

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


class _Loaded:
    """As much of a loaded case as the reader of photographs needs."""

    mesh_from_model = np.eye(4)

    class case:
        mm_per_unit = 1000.0


def _photographs(path: Path) -> object:
    from oneframe.evaluation.photographs import read_photographs

    return read_photographs(path, _Loaded())  # type: ignore[arg-type]


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


def _film(path: Path) -> object:
    from oneframe.video.frame_scores import score_frames

    return score_frames(path)


def _button(operator: str) -> Callable[[Path], object]:
    """An operator of the add-on: its report of an error is what Blender raises here."""

    def press(path: Path) -> object:
        import bpy

        if not hasattr(bpy.types.Scene, "oneframe"):
            import blender_addon

            bpy.ops.wm.read_factory_settings(use_empty=True)
            blender_addon.register()
        try:
            return getattr(bpy.ops.oneframe, operator)(filepath=str(path))
        except RuntimeError as error:
            text = str(error).removeprefix("Error: ").strip()
            if "Traceback" in text or "\n" in text:
                raise
            raise InputError(text) from None

    return press


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
    "film": _film,
    "volume": lambda path: read_volume(path),
    "slice": lambda path: read_volume(path.parent),
    "labels": lambda path: read_labels(path),
    "drill plan": lambda path: read_drill_plan(path),
    **{
        f"button {name}": _button(name)
        for name in ("load_frame", "load_camera", "load_surface", "load_pose", "open_case", "load_video_frame")
    },
}


def peak_mb() -> float:
    """Largest memory since the last :func:`forget_peak`, of this process and its children."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024


def forget_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5")


def main() -> None:
    # numbers that overflow would warn on the terminal
    warnings.simplefilter("error")
    warnings.filterwarnings("ignore", category=DeprecationWarning)
    answers = open(int(sys.argv[1]), "w", buffering=1)  # noqa: SIM115 - as long as the process
    for line in sys.stdin:
        request = json.loads(line)
        forget_peak()
        try:
            READERS[request["reader"]](Path(request["path"]))
            answer = {"kind": "value"}
        except InputError as error:
            answer = {"kind": "sentence", "text": str(error)}
        except BaseException:
            answer = {"kind": "defect", "text": traceback.format_exc()[-2000:]}
        answer["mb"] = peak_mb()
        answers.write(json.dumps(answer) + "\n")


if __name__ == "__main__":
    main()
