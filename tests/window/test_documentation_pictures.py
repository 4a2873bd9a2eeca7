"""Takes the pictures of the documentation into the folder that ``make screenshots`` names; else it does nothing."""

import os
from pathlib import Path

import pytest
from PIL import Image

from tests.window import session
from tests.window.conftest import PICTURES

FOLDER = os.environ.get("ONEFRAME_SCREENSHOTS", "")
pytestmark = [pytest.mark.window, pytest.mark.skipif(not FOLDER, reason="make screenshots takes them")]

SCENARIO = Path(__file__).with_name("documentation_scenario.py")
WINDOW, TIMEOUT_S = (1440, 880), 900
QUALITY = {"quality": 86, "optimize": True, "subsampling": 0}
VIEWS = 24
SHOWN_VIEWS = (0, 8, 16)
"""Views of the dataset that the first page shows next to the overlay."""
GAP_PX = 6


def test_take_the_pictures(blender, resources, sample, run_oneframe, tmp_path):
    dataset, overlay = tmp_path / "dataset", tmp_path / "overlay.png"
    for arguments in (["render", sample, "--out", dataset, "--count", VIEWS], ["overlay", sample, "--out", overlay]):
        assert run_oneframe(*arguments).returncode == 0
    pictures = {
        "first_page": first_page(sample, dataset),
        "contact_sheet": Image.open(dataset / "contact_sheet.png").convert("RGB"),
        "overlay": Image.open(overlay).convert("RGB"),
    }
    work, shots = tmp_path / "session", tmp_path / "pictures"
    work.mkdir()
    facts = session.play_scenario(
        blender,
        SCENARIO,
        resources=resources,
        case=sample,
        folder=work,
        pictures=shots,
        timeout_s=TIMEOUT_S,
        size_wh=WINDOW,
    )
    for name, (left, top, width, height) in facts["crops"].items():
        pictures[name] = Image.open(shots / f"{name}.png").crop((left, top, left + width, top + height))
    for name, picture in pictures.items():
        picture.save(Path(FOLDER, f"{name}.jpg"), "JPEG", **QUALITY)


@pytest.mark.parametrize("name", ["first_session", "frames"])
def test_take_the_pictures_of_a_scenario(play, name):
    play(Path(__file__).with_name(f"scenario_{name}.py"), TIMEOUT_S)
    taken = sorted((PICTURES / name).glob("*.png"))
    shots = {f"first_session_{at}": path for at, path in enumerate(taken, 1)}
    if name == "frames":
        of_frames = {"video": "0_not_registered", "frames": "3_found", "queue": "4_queue"}
        shots = {picture: PICTURES / name / f"{shot}.png" for picture, shot in of_frames.items()}
    for picture, path in shots.items():
        Image.open(path).save(Path(FOLDER, f"{picture}.jpg"), "JPEG", **QUALITY)


def first_page(case: Path, dataset: Path) -> Image.Image:
    """The frame and, next to it, the overlay and three views of the dataset at half its size."""
    views = [dataset / "train_synt" / "000000" / "rgb" / f"{number:06d}.png" for number in SHOWN_VIEWS]
    frame, *small = (
        Image.open(path).convert("RGB") for path in (case.parent / "frame.png", dataset / "overlay.png", *views)
    )
    width, height = (frame.width - GAP_PX) // 2, (frame.height - GAP_PX) // 2
    page = Image.new("RGB", (2 * frame.width + GAP_PX, frame.height), "white")
    page.paste(frame, (0, 0))
    for number, view in enumerate(small):
        row, column = divmod(number, 2)
        place = frame.width + GAP_PX + column * (width + GAP_PX), row * (height + GAP_PX)
        page.paste(view.resize((width, height), Image.Resampling.LANCZOS), place)
    return page.resize((page.width * 2 // 3, page.height * 2 // 3), Image.Resampling.LANCZOS)
