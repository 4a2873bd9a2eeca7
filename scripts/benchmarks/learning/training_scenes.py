"""Cases with held-out photographs, and the datasets of them that a network is trained on."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from oneframe.blender.sample.photograph import take_photographs
from oneframe.blender.sample.sample_case import FILM, FILM_POSES, HELD_OUT, write_sample_case, write_sample_film
from oneframe.case.case_file import read_case
from oneframe.case.case_writer import write_case
from oneframe.errors import RunError
from oneframe.files.outputs import made_folder
from oneframe.files.tables import parsed_json
from oneframe.files.writing import write_bytes_atomically
from oneframe.images.image_reader import read_image
from oneframe.images.pixel_values import to_uint8
from oneframe.progress import Progress
from oneframe.reader import Dataset, View, open_dataset
from oneframe.sample.temporal_bone import MICROSCOPE, sample_surface
from oneframe.transforms import inverse_rigid
from oneframe.video.film_reader import WIDEST, Film

from ..evaluation import lit_case
from ..published import bloster_cases

NEUTRAL = "neutral"
"""As ``oneframe render`` has it by default."""
DATASETS: Mapping[str, tuple[str, ...]] = {
    NEUTRAL: (),
    "fill": ("--unseen", "fill"),
    "vertex": ("--colour", "vertex"),
    "lens": ("--light", "lens"),
    "shadows": ("--light", "shadows"),
    "fill-lens": ("--unseen", "fill", "--light", "lens"),
    "fill-shadows": ("--unseen", "fill", "--light", "shadows"),
    "highlights": ("--unseen", "fill", "--light", "lens", "--highlights", "drop"),
    "occluders": ("--unseen", "fill", "--light", "lens", "--occluders", "1.5"),
    "surroundings": ("--unseen", "fill", "--surroundings", "frame"),
    "cone10": ("--cone-deg", "10"),
    "cone35": ("--cone-deg", "35"),
}
"""Options of ``oneframe render`` by dataset; a scene's own come before them."""
FRAMES = "frames"
"""The case with the colours of further, registered frames."""
PHOTOGRAPHS = "photographs"
"""Photographs at the poses of the default views: the best that views could be."""
PHOTOGRAPH_SAMPLES = 12
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
    film
        Whose frames colour :data:`FRAMES`, if there is one.
    photographer
        Takes photographs as :func:`.take_photographs` does, of ``cam_from_mesh`` in mm; none of a real scene.
    """

    name: str
    case: Path
    photographs: Path
    folder: Path
    options: tuple[str, ...] = ()
    real: bool = True
    film: Path | None = None
    photographer: Callable[..., Iterator[Path]] | None = None

    def offers(self, name: str) -> bool:
        """Whether it has what a dataset needs: further frames, a lamp, or a photographer."""
        if "--light" in DATASETS.get(name, ()):
            return read_case(self.case).light is not None
        return bool({FRAMES: self.film, PHOTOGRAPHS: self.photographer}.get(name, True))

    def dataset(self, name: str, count: int) -> Dataset:
        """Open the dataset; render it first if it is not there or has fewer views."""
        folder = self.folder / (NEUTRAL if name == PHOTOGRAPHS else name)
        if not (folder / "dataset_info.md").is_file() or len(open_dataset(folder)) < count:
            options = [*self.options, *DATASETS.get(name, ()), "--engine", "raster", "--count", str(count)]
            _oneframe("render", self._registered() if name == FRAMES else self.case, "--out", folder, *options)
        return open_dataset(folder)

    def _registered(self) -> Path:
        assert self.film
        folder = self.folder / "registered"
        if not (folder / "case.toml").is_file():
            _oneframe("register", self.case, self.film, "--out", folder, *FRAME_OPTIONS)
        return folder / "case.toml"

    def photographed(self, views: Dataset, mesh_from_model: np.ndarray) -> Callable[[View], np.ndarray]:
        """Photograph the surface at the poses of views, where that is not yet done; gives the pictures by view."""
        assert self.photographer
        folder, camera = self.folder / PHOTOGRAPHS, read_case(self.case).camera.resized(*views.size_wh)
        model_from_mesh = inverse_rigid(mesh_from_model)
        files = [folder / f"{view.index:06d}.png" for view in views]
        missing = [
            (view.cam_from_model @ model_from_mesh, made_folder(file))
            for view, file in zip(views, files, strict=True)
            if not file.is_file()
        ]
        with Progress(len(missing), "photographs", stream=sys.stderr) as progress:
            for _ in self.photographer(camera, missing, samples=PHOTOGRAPH_SAMPLES):
                progress.advance()
        return lambda view: to_uint8(read_image(folder / f"{view.index:06d}.png")[0])


def sample_scene(folder: Path) -> TrainingScene:
    """The built-in sample: its held-out photographs, and every other clean frame of its film.

    From frames of the film between those come the colours of :data:`FRAMES`. Its lamp is given, where it truly is.
    """
    surface = sample_surface()
    case, listed = folder / "case", folder / "case" / "photographs.json"
    if not listed.is_file():
        for _ in (*write_sample_case(case, surface), *write_sample_film(case, surface)):
            pass
        write_bytes_atomically(listed, json.dumps(_clean_frames(case)).encode())
    lit = case / "lit.toml"
    if not lit.is_file():
        write_case(lit, lit_case(case / "case.toml"))
    scale = f"--scale={VIEW_WIDTH / MICROSCOPE.width!r}"
    photographer = partial(take_photographs, surface)
    return TrainingScene(
        "sample", lit, listed, folder, (scale,), real=False, film=case / FILM, photographer=photographer
    )


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
