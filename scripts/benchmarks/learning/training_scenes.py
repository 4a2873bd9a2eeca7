"""Cases with held-out photographs, and the datasets of them that a network is trained on."""

import json
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2

from oneframe.blender.sample.sample_case import FILM, FILM_POSES, HELD_OUT, write_sample_case, write_sample_film
from oneframe.errors import RunError
from oneframe.files.content import write_bytes_atomically
from oneframe.files.tables import parsed_json
from oneframe.reader import Dataset, open_dataset
from oneframe.sample.temporal_bone import MICROSCOPE, sample_surface
from oneframe.video.film_reader import WIDEST, Film

from ..published import bloster_cases

NEUTRAL, PLAIN = "neutral", "plain"
"""As ``oneframe render`` has it by default; the same views without the frame's colours, see :class:`.ViewCrops`."""
DATASETS: Mapping[str, tuple[str, ...]] = {
    NEUTRAL: (),
    "fill": ("--unseen", "fill"),
    "vertex": ("--colour", "vertex"),
    PLAIN: (),
    "samples4": ("--samples", "4"),
    "cone10": ("--cone-deg", "10"),
    "cone35": ("--cone-deg", "35"),
}
"""Options of ``oneframe render`` by dataset; a scene's own come before them."""
FRAMES = "frames"
"""The case with the colours of further, registered frames."""
FRAME_OPTIONS = ("--colour-frames", "6", "--every", "4")
BLOSTER_POSES = (
    "--cone-deg=55", "--roll-deg=60", "--distance-min=0.75", "--distance-max=1.25", "--shift-mm=250",
)  # fmt: skip
"""Its photographs are taken by hand from all around."""
PROGRAM = Path(__file__).resolve().parents[2] / "oneframe.py"
VIEW_WIDTH = 128
"""Of the sample's views, px; in bloster's of twice this width the object is as large."""


@dataclass(frozen=True)
class TrainingScene:
    """A case and its photographs.

    Attributes
    ----------
    name
        Of the scene.
    case, photographs
        Case file, and list as for ``oneframe evaluate``.
    folder
        Where its datasets are.
    options
        Of ``oneframe render``, for all of them.
    real
        Whether the photographs are, not rendered.
    more
        Other case files by dataset.
    """

    name: str
    case: Path
    photographs: Path
    folder: Path
    options: tuple[str, ...] = ()
    real: bool = True
    more: Mapping[str, Path] = field(default_factory=dict)

    def dataset(self, name: str, count: int) -> Dataset:
        """Open the dataset; render it first if it is not there or has fewer views."""
        folder = self.folder / (NEUTRAL if name == PLAIN else name)
        if not (folder / "dataset_info.md").is_file() or len(open_dataset(folder)) < count:
            options = [*self.options, *DATASETS.get(name, ()), "--engine", "raster", "--count", str(count)]
            _oneframe("render", self.more.get(name, self.case), "--out", folder, *options)
        return open_dataset(folder)


def sample_scene(folder: Path) -> TrainingScene:
    """The built-in sample: its held-out photographs, and every other clean frame of its film.

    From frames of the film between those come the colours of :data:`FRAMES`.
    """
    case, registered, listed = folder / "case", folder / "registered", folder / "case" / "photographs.json"
    if not listed.is_file():
        surface = sample_surface()
        for _ in (*write_sample_case(case, surface), *write_sample_film(case, surface)):
            pass
        write_bytes_atomically(listed, json.dumps(_clean_frames(case)).encode())
    if not (registered / "case.toml").is_file():
        _oneframe("register", case / "case.toml", case / FILM, "--out", registered, *FRAME_OPTIONS)
    scale = f"--scale={VIEW_WIDTH / MICROSCOPE.width!r}"
    more = {FRAMES: registered / "case.toml"}
    return TrainingScene("sample", case / "case.toml", listed, folder, (scale,), real=False, more=more)


def bloster_scene(data: Path, folder: Path) -> TrainingScene:
    """Bloster from its second source; ``data`` as for :func:`.read_bloster`."""
    case, listed = bloster_cases(data, folder / "case")[1]
    return TrainingScene("bloster", case, listed, folder, (f"--scale={2 * VIEW_WIDTH / 1920!r}", *BLOSTER_POSES))


def _clean_frames(case: Path) -> list[dict]:
    """The held-out photographs and the odd frames of the film that nothing spoils, written as pictures."""
    listed = parsed_json((case / HELD_OUT).read_bytes(), HELD_OUT)
    frames = {frame["frame"]: frame for frame in parsed_json((case / FILM_POSES).read_bytes(), FILM_POSES)}
    with Film(case / FILM, width=WIDEST) as film:
        for each in film:
            frame = frames[each.index]
            if each.index % 2 and not frame["disturbance"]:
                name = f"held_out/film_{each.index:03d}.png"
                image = cv2.resize(each.image, MICROSCOPE.size_wh, interpolation=cv2.INTER_CUBIC)
                cv2.imwrite(str(case / name), image[..., ::-1])
                listed.append({"image": name, "cam_from_mesh": frame["cam_from_mesh"]})
    return listed


def _oneframe(command: str, *arguments: str | Path) -> None:
    line = [sys.executable, PROGRAM, command, *arguments]
    ended = subprocess.run(line, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if ended.returncode:
        raise RunError(f"oneframe {command}: expected its files, it failed: {ended.stderr.strip()[-300:]}")
