"""Put synthetic views of one frame beside real photographs of the same poses, and measure their likeness.

    python scripts/compare_views.py CASE.toml PHOTOGRAPHS.json --out DIR [--colour projective|texture|vertex]

PHOTOGRAPHS.json is a list of {"image": file, "cam_from_mesh": 4x4}. Writes likeness.csv, a picture of each pair and a
sheet of all of them.
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import argparse
import csv
import io
from collections.abc import Sequence

from pipeline.blender.case.load_case import load_case
from pipeline.blender.command_line import own_output, run_script
from pipeline.blender.evaluation.comparison import compare
from pipeline.case.case_file import read_case
from pipeline.dataset.options import COLOURS
from pipeline.evaluation.photographs import read_photographs
from pipeline.files.content import write_bytes_atomically
from pipeline.images.contact_sheet import contact_sheet
from pipeline.images.pixel_values import to_uint8
from pipeline.images.png import encode_png


def main(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], epilog=__doc__.split("\n\n")[-1],
    )  # fmt: skip
    parser.add_argument("case", metavar="CASE.toml", type=Path)
    parser.add_argument("photographs", metavar="PHOTOGRAPHS.json", type=Path)
    parser.add_argument("--out", metavar="DIR", type=Path, required=True)
    parser.add_argument("--colour", choices=COLOURS, default=COLOURS[0])
    arguments = parser.parse_args(argv)
    output = own_output()
    loaded = load_case(read_case(arguments.case))
    photographs = read_photographs(arguments.photographs, loaded)
    arguments.out.mkdir(parents=True, exist_ok=True)
    table, pictures = io.StringIO(newline=""), []
    rows = csv.writer(table, lineterminator="\n")
    rows.writerow(["image", "ssim", "mean_error_of_255", "correlation", "pixels"])
    for comparison in compare(loaded, photographs, colour=arguments.colour):
        found, name = comparison.likeness, comparison.photograph.path.name
        rows.writerow([name, f"{found.ssim:.4f}", f"{found.mean_error:.2f}", f"{found.correlation:.4f}", found.pixels])
        output.write(
            f"{name}: SSIM {found.ssim:.3f}, mean error {found.mean_error:.1f}/255, "
            f"correlation {found.correlation:.3f} over {found.pixels} px\n"
        )
        output.flush()
        pictures.append(comparison.picture())
        write_bytes_atomically(arguments.out / f"{Path(name).stem}.png", encode_png(to_uint8(pictures[-1])))
    write_bytes_atomically(arguments.out / "likeness.csv", table.getvalue().encode())
    sheet = contact_sheet(pictures, columns=2, tile_width=900)
    write_bytes_atomically(arguments.out / "sheet.png", encode_png(to_uint8(sheet)))
    output.write(f"photograph, view, difference: {arguments.out / 'sheet.png'}\n")
    output.flush()
    return 0


if __name__ == "__main__":
    run_script(main)
