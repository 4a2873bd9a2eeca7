"""The command ``oneframe frames``."""

from dataclasses import MISSING, dataclass
from pathlib import Path

from ..errors import InputError
from ..process.command import option, positional
from ..process.own_process import own_output

ABOUT = "Find the best frames of a microscope video: sharp, well exposed, free of instruments, hands and glare."
EPILOG = """examples:
  %(prog)s surgery.mp4 --out frames
  %(prog)s surgery.mp4 --out frames --count 10 --from 95 --to 140
  %(prog)s long.mp4 --out frames --every 5

Every frame is scored by its sharpness, exposure, glare and motion, and by how much of the view metal and gloves cover,
by their colour. The best frames are written twice: as decoded, and with alpha 0 where they show no tissue (instruments,
glare, the black around a microscope's circle). Both can be the frame of a case; look at contact_sheet.png first.
scores.csv has a line for each frame.
"""


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    video: Path = positional("VIDEO", "a video: MP4, MOV, MKV, WebM, AVI, ...")
    count: int = option("N", "number of frames to write at most (default %(default)s)", 5, least=1)
    every: int = option("N", "score only every N-th frame (default %(default)s)", 1, least=1)
    from_s: float = option("S", "start at this time in s", 0.0, least=0, flag="--from")
    to_s: float | None = option("S", "end at this time in s (default: the end)", least=0, flag="--to")
    out: Path = option("DIR", "folder to write", MISSING)


def run(arguments: Arguments) -> None:
    """Score the film, write the best frames and report them."""
    if arguments.to_s is not None and arguments.to_s <= arguments.from_s:
        raise InputError(
            f"command line: --to: expected a time after --from {arguments.from_s:g}, found {arguments.to_s:g}"
        )
    from ..progress import ShareProgress
    from ..video.frame_folder import SHEET, TABLE, check_frame_folder, frame_line, report_lines, write_frames
    from ..video.frame_scores import best_frames, score_frames

    output = own_output()
    video, out = arguments.video, arguments.out
    check_frame_folder(out, video)
    with ShareProgress("of the film", stream=output) as shown:
        scores = score_frames(
            video, every=arguments.every, from_s=arguments.from_s, to_s=arguments.to_s, progress=shown.reach
        )
    chosen = best_frames(scores.frames, arguments.count)
    output.writelines(f"{line}\n" for line in report_lines(video, scores, len(chosen), arguments.count))
    written = write_frames(video, out, scores, chosen)
    for rank, frame in enumerate(written, start=1):
        output.write(frame_line(rank, frame) + "\n")
    if written:
        output.write(f"frames beside what is masked in them: {out / SHEET}\n")
    output.write(f"scores of all frames: {out / TABLE}\n")
    if not written:
        raise InputError(f"{video.name}: expected a frame that shows something sharply, found none; see {out / TABLE}")
