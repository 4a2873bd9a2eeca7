"""The command ``oneframe register``."""

import datetime
from collections.abc import Iterator
from dataclasses import MISSING, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from .. import __version__
from ..errors import InputError
from ..process.command import option, positional, switch
from ..process.own_process import own_output

if TYPE_CHECKING:
    from ..case.loaded_case import LoadedCase
    from ..registration.register_case import RegistrationEvidence

ABOUT = "Find the pose of further frames of a case, from images or a video, without any training."
EPILOG = """examples:
  %(prog)s case.toml frames --out registered
  %(prog)s case.toml surgery.mp4 --out registered
  %(prog)s case.toml surgery.mp4 --out registered --every 25
  %(prog)s case.toml surgery.mp4 --out registered --correct-source
  %(prog)s case.toml surgery.mp4 --out registered --network network.onnx

The frames are of the case's camera: the same K, or the same proportions, to which K is scaled; or of their own, in a
list as for oneframe evaluate, poses or not: JSON, BOP's scene_camera.json, COLMAP's images.txt. Each is accepted,
doubtful or refused, with the probability that its pose is within 2 degrees, 2 %% of the distance and 5 px of what the
case's own pose says. DIR gets poses.json (cam_from_mesh of accepted and doubtful frames, with state, reason and
covariance), registration.html, on which to check them, and of a video overlay.mp4: the overlay is the fainter the less
sure its pose is, and what is not accepted is marked.

--correct-source first finds the pose of the case's own frame and those of up to 24 of the frames together, as in bundle
adjustment: a pose of the case that is some degrees off comes back, where the frames determine it. --colour-frames
chooses accepted frames, sharp and clear ones, that see most of what the case's own frame did not: they colour that, in
its exposure.
DIR/case.toml holds the case with the new pose and these frames.

--network takes what oneframe train wrote, of views of this surface: a frame starts at the network's pose, and is
refined and judged like any other; where that is not sure, the network sees it in the colours' range of the case's
frame, then features are tried, and the most probable pose counts. No PyTorch is needed.
"""


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    case: Path = positional("CASE.toml", "the aligned case")
    frames: Path = positional("FRAMES", "a folder or a list of images, or a video")
    out: Path = option("DIR", "folder to write", MISSING)
    correct_source: bool = switch("first correct the case's own pose by the frames")
    colour_frames: int = option(
        "N", "also write the case with up to N of the frames to colour its surface with", 0, least=1
    )  # fmt: skip
    network: Path | None = option("FILE.onnx", "find first poses by a network of oneframe train")
    every: int = option("N", "register every N-th frame only", 1, least=1)


def run(arguments: Arguments) -> None:
    """Register the frames, write the files and report what was found."""
    from ..case.case_changes import other_inputs
    from ..case.case_file import read_case
    from ..case.case_folder import remove_unnamed
    from ..case.case_writer import write_case
    from ..case.loaded_case import load_case
    from ..files.outputs import check_outputs, check_own_folder, write_output, writing
    from ..progress import ShareProgress
    from ..registration.further_frames import frame_files
    from ..registration.register import Registrar, doubt_of_case
    from ..registration.register_case import CASE, FILES, NAMES, PAGE, register_case
    from ..report.registration_page import registration_page

    output, out, network = own_output(), arguments.out, arguments.network
    case = read_case(arguments.case)
    inputs = case.input_files() | frame_files(arguments.frames) | ({"network": network} if network else {})
    check_own_folder(out, NAMES, inputs)
    check_outputs([out / name for name in FILES], inputs)
    if other := other_inputs(out / CASE, case):
        raise InputError(
            f"{out}: expected an empty folder or one of this frame and surface, found a case of {' and '.join(other)}; "
            f"choose another folder"
        )
    loaded, comment, guess = load_case(case).with_shown_structures(), "", None
    if network:
        from ..learning.pose_network import PoseNetwork

        guess = PoseNetwork.read(network, loaded).poses
    output.writelines(f"note: {message}\n" for message in loaded.messages)
    if arguments.correct_source:
        loaded, comment = _corrected(arguments.frames, loaded, output)
    if doubt := doubt_of_case(loaded):
        output.write(f"note: {doubt}\n")
    with ShareProgress("of the frames", stream=output) as shown:
        evidence = register_case(
            Registrar(loaded, guess), arguments.frames, out,
            every=arguments.every, colour_frames=arguments.colour_frames, progress=shown.reach,
        )  # fmt: skip
    if evidence.is_film:
        _write_film(arguments, loaded, evidence, output)
    write_output(out / PAGE, registration_page(evidence, name=out.resolve().name))
    if arguments.correct_source or arguments.colour_frames:
        further = (*loaded.case.frames, *evidence.colouring)
        with writing(out / CASE):
            write_case(out / CASE, replace(loaded.case, frames=further), comment=comment)
        remove_unnamed(out)
        images = f", with {len(further)} further frames" if further else ""
        output.write(f"the case{images}: {out / CASE}\n")
    elif (out / CASE).exists():
        output.write(f"note: {out / CASE} is of an earlier run: its pose may be another than these frames go by\n")
    output.writelines(f"{line}\n" for line in _report(evidence, out))


def _corrected(frames: Path, loaded: "LoadedCase", output: TextIO) -> "tuple[LoadedCase, str]":
    """The case with a pose corrected by the frames, and a comment for its file."""
    from ..progress import ShareProgress
    from ..registration.correct_pose import correct_pose

    case, today = loaded.case, datetime.date.today().isoformat()
    with ShareProgress("of the case's pose", stream=output) as shown:
        corrected, text = correct_pose(
            loaded, frames, tool=f"OneFrame {__version__}, register", date=today, progress=shown.reach
        )
    output.write(f"{text}\n")
    if case.frames:
        output.write(
            f"note: the case's {len(case.frames)} further frames keep their poses; if these are from before, take "
            f"them out and choose frames with --colour-frames\n"
        )
    return corrected, f"{text}\nbefore, in mm: cam_from_mesh = {case.cam_from_mesh.tolist()}"


def _write_film(arguments: Arguments, loaded: "LoadedCase", evidence: "RegistrationEvidence", output: TextIO) -> None:
    from ..blender.render.lettering import text_mask
    from ..blender.render.video import stream_video
    from ..files.outputs import writing
    from ..progress import Progress
    from ..registration.register_case import FILM, marked_film
    from ..video.film_reader import WIDEST, Film

    path = arguments.out / FILM
    with Film(arguments.frames, every=arguments.every, width=WIDEST) as film, writing(path):
        drawing = marked_film(loaded, film, evidence.frames, text_mask)
        with Progress(drawing.count, "frames of the film", stream=output) as shown:
            pictures, aspect = drawing.pictures(shown.advance), drawing.pixel_aspect
            stream_video(path, pictures, drawing.count, fps=drawing.fps, pixel_aspect=aspect)


def _report(evidence: "RegistrationEvidence", out: Path) -> Iterator[str]:
    """What was found and where it stands, in lines."""
    from ..registration.pose_list import POSES
    from ..registration.register_case import FILM, PAGE
    from ..registration.verdict import ACCEPTED

    yield from evidence.colouring_lines
    if evidence.cut_off:
        yield f"note: {evidence.cut_off}"
    if not evidence.counts[ACCEPTED]:
        yield "note: no frame is sure to show what the case's frame shows: is it the same surface, side and zoom?"
    if evidence.change is not None:
        yield f"note: {evidence.change.words()}"
    yield ", ".join(f"{count} {state}" for state, count in evidence.counts.items()) + f": {out / POSES}"
    if evidence.is_film:
        yield f"the film with the overlay: {out / FILM}"
    yield f"all frames on one page, to look at in a browser: {out / PAGE}"
