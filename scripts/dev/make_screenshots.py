"""Take the pictures of the documentation: of the real Blender window, and of a dataset of the sample case.

python scripts/dev/make_screenshots.py --blender PROGRAM [--out docs/img]
"""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# the package, the tests and the other scripts, also where nothing is installed
sys.path[:0] = [str(ROOT), str(ROOT / "scripts")]

import argparse
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence

from PIL import Image

from oneframe.errors import InputError, RunError
from oneframe.files.outputs import check_outputs
from scripts.dev import build_extension
from tests.window import session

SCENARIO = ROOT / "scripts" / "dev" / "screenshot_scenario.py"
WINDOW = 1440, 880
TIMEOUT_S = 900
QUALITY = {"quality": 86, "optimize": True, "subsampling": 0}
VIEWS = 24
SHOWN_VIEWS = (0, 8, 16)
"""Views of the dataset that the first page shows next to the overlay."""
GAP_PX = 6


def parse_arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make_screenshots.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--blender", metavar="PROGRAM", default=os.environ.get("BLENDER"), help="default: $BLENDER")
    parser.add_argument("--out", metavar="DIR", type=Path, default=ROOT / "docs" / "img", help="default: docs/img")
    return parser.parse_args(argv)


def sample_dataset(folder: Path) -> tuple[Path, Path]:
    """Make the sample case and a small dataset of it with the user's commands; returns case file and dataset folder."""
    case, dataset = folder / "case" / "case.toml", folder / "dataset"
    script(ROOT / "scripts" / "oneframe.py", "sample", "--out", case.parent)
    script(ROOT / "scripts" / "render_dataset.py", case, "--out", dataset, "--count", VIEWS)
    return case, dataset


def script(path: Path, *arguments: object) -> None:
    """Run one of the project's scripts.

    Raises
    ------
    RunError
        It failed.
    """
    ended = subprocess.run([sys.executable, path, *map(str, arguments)], check=False)
    if ended.returncode != 0:
        raise RunError(f"{path.name} ended with status {ended.returncode}")


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


def window_pictures(blender: str, case: Path, folder: Path) -> dict[str, Image.Image]:
    """Play the scenario in Blender's window; returns the pictures by name."""
    (package,) = build_extension.build([build_extension.this_platform()], folder / "extension")
    resources, pictures = folder / "resources", folder / "pictures"
    resources.mkdir()
    session.install_extension(blender, package, resources)
    work = folder / "session"
    work.mkdir()
    facts = session.play_scenario(
        blender,
        SCENARIO,
        resources=resources,
        case=case,
        folder=work,
        pictures=pictures,
        timeout_s=TIMEOUT_S,
        size_wh=WINDOW,
    )
    return {
        name: Image.open(pictures / f"{name}.png").crop((left, top, left + width, top + height))
        for name, (left, top, width, height) in facts["crops"].items()
    }


def main(argv: Sequence[str]) -> int:
    arguments = parse_arguments(argv)
    try:
        blender = build_extension.found_blender(arguments.blender, "screenshots")
        if not shutil.which("Xvfb"):
            raise InputError("expected Xvfb, a virtual display for Blender's window, found none; install it")
        with tempfile.TemporaryDirectory(prefix="oneframe-screenshots-") as name:
            folder = Path(name)
            case, dataset = sample_dataset(folder)
            pictures = window_pictures(blender, case, folder)
            pictures["first_page"] = first_page(case, dataset)
            pictures["contact_sheet"] = Image.open(dataset / "contact_sheet.png").convert("RGB")
            script(ROOT / "scripts" / "oneframe.py", "overlay", case, "--out", folder / "overlay.png")
            pictures["overlay"] = Image.open(folder / "overlay.png").convert("RGB")
            save(pictures, arguments.out)
    except (InputError, RunError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2 if isinstance(error, InputError) else 3
    return 0


def save(pictures: dict[str, Image.Image], out: Path) -> None:
    """Write each picture as JPEG, whole or not at all."""
    check_outputs([out / f"{name}.jpg" for name in pictures], {})
    out.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures.items():
        path = out / f"{name}.jpg"
        partial = path.with_name(f".partial-{path.name}")
        picture.save(partial, "JPEG", **QUALITY)
        os.replace(partial, path)
        print(f"{path}: {picture.width}x{picture.height} px, {path.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
