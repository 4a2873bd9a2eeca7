"""The command ``oneframe sample``."""

import time
from dataclasses import dataclass
from pathlib import Path

from ..process.command import option, switch
from ..process.own_process import own_output

ABOUT = "Make the built-in sample case: a drilled temporal bone, a microscope frame of it, and held-out photographs."
EPILOG = """examples:
  %(prog)s
  %(prog)s --out demo/case
  %(prog)s --film

The command writes case.toml, frame.png, surface.ply, structures/, held_out/ and held_out.json into the folder; --film
adds film.mp4, 60 frames with instruments, blur and glare in some, and their poses, film.json.
"""


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    out: Path = option("DIR", "folder to write (default: %(default)s)", Path("sample_case"))
    film: bool = switch("also make a film of it, which takes some minutes")


def run(arguments: Arguments) -> None:
    """Write the sample case and report each file."""
    from ..blender.sample.sample_case import check_sample_case, write_sample_case, write_sample_film
    from ..sample.temporal_bone import sample_surface

    output = own_output()
    start = time.monotonic()
    check_sample_case(arguments.out)
    surface = sample_surface()
    output.write(f"surface of {len(surface.bone.faces)} triangles\n")
    for path in write_sample_case(arguments.out, surface):
        output.write(f"{time.monotonic() - start:6.1f} s  {path}\n")
    if arguments.film:
        for path in write_sample_film(arguments.out, surface):
            output.write(f"{time.monotonic() - start:6.1f} s  {path}\n")
    output.write(f"next: oneframe render {arguments.out / 'case.toml'} --out dataset\n")
