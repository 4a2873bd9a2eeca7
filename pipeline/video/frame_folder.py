"""What the selection leaves in a folder: the chosen frames, each also with its mask as alpha, a sheet, a table."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..errors import InputError
from ..files.outputs import check_outputs, check_own_folder, made_folder, write_output, writing
from ..files.tables import write_csv
from ..images.contact_sheet import contact_sheet, downscaled
from ..images.pixel_values import to_uint8
from ..images.png import encode_png
from .film_reader import WIDEST, Film, read_video_frame
from .frame_mask import tissue_mask
from .frame_scores import COMBED, FilmScores, FrameScore

TABLE, SHEET = "scores.csv", "contact_sheet.png"
COLUMNS = (
    "frame", "time_s", "chosen", "score", "sharpness", "exposure_stops", "glare", "obstructed", "motion_px",
    "comb_ratio",
)  # fmt: skip
_NAMES = r".+_frame_\d{6,}(_masked)?\.png|contact_sheet\.png|scores\.csv"
TILE_WIDTH = 640
MASKED_COLOUR = np.array([1.0, 0.0, 1.0], np.float32)

DOUBTFUL = 0.5
"""Score of the best frame below which a film shows nothing well: noise, or a camera that never rests."""

DEINTERLACE = "to use one, deinterlace the film, for example with ffmpeg -vf yadif"
INTERLACED_SHARE = 0.05
"""Share of the frames with combs from which on a film is called interlaced."""


@dataclass(frozen=True)
class ChosenFrame:
    """A frame on disk.

    Attributes
    ----------
    score
        Its score.
    image, masked
        Its files: as decoded, and with alpha 0 where it shows no tissue.
    tissue
        Share of its pixels that are not masked, 0..1.
    """

    score: FrameScore
    image: Path
    masked: Path
    tissue: float


def check_frame_folder(out: Path, video: Path) -> None:
    """Check before any work that the folder holds nothing else, and that the files of known names can be written."""
    check_own_folder(out, _NAMES, {"video": video})
    check_outputs([out / SHEET, out / TABLE], {"video": video})


def write_frames(
    video: Path,
    out: Path,
    scores: FilmScores,
    chosen: Sequence[FrameScore],
) -> list[ChosenFrame]:
    """Write frames, masked frames, contact sheet and table.

    ``chosen`` are the frames to write, the best first; the folder is created if it does not exist.
    """
    files = [_files(video, out, each) for each in chosen]
    check_outputs([out / SHEET, out / TABLE, *(path for pair in files for path in pair)], {"video": video})
    made_folder(out / SHEET)
    written: list[ChosenFrame] = []
    tiles: list[np.ndarray] = []
    for rank, (score, (image_file, masked_file)) in enumerate(zip(chosen, files, strict=True), start=1):
        picture = read_video_frame(video, score.index)
        mask = tissue_mask(picture, scores.inside)
        write_new(image_file, encode_png(picture))
        write_new(masked_file, _encoded_masked(picture, mask))
        written.append(ChosenFrame(score, image_file, masked_file, float(mask.mean())))
        tiles += _tiles(picture, mask, score, rank)
    if tiles:
        sheet = contact_sheet(tiles, columns=2, tile_width=TILE_WIDTH)
        write_output(out / SHEET, encode_png(to_uint8(sheet)))
    with writing(out / TABLE):
        write_csv(out / TABLE, COLUMNS, _rows(scores.frames, [each.index for each in chosen]))
    return written


def write_frame(video: Path, folder: Path, scores: FilmScores, score: FrameScore, *, masked: bool = False) -> Path:
    """Write one frame, chosen or not, under the name and with the content that :func:`write_frames` gives it.

    Into an existing folder; ``masked``: with alpha 0 where it shows no tissue, instead of the frame as decoded.
    """
    path = _files(video, folder, score)[masked]
    check_outputs([path], {"video": video})
    picture = read_video_frame(video, score.index)
    write_new(path, _encoded_masked(picture, tissue_mask(picture, scores.inside)) if masked else encode_png(picture))
    return path


def write_frames_only(video: Path, folder: Path, chosen: Sequence[FrameScore]) -> Iterator[Path]:
    """Write frames as :func:`write_frame` does, one after the other; the film is decoded once.

    Into an existing folder; ``chosen`` are in the order of the film.

    Yields
    ------
    The file of each.
    """
    files = [_files(video, folder, score)[0] for score in chosen]
    check_outputs(files, {"video": video})
    left = dict(zip((score.index for score in chosen), files, strict=True))
    with Film(video, numbers=(chosen[0].index, chosen[-1].index + 1), width=WIDEST) as film:
        for frame in film:
            if frame.index not in left:
                continue
            file = left.pop(frame.index)
            write_new(file, encode_png(frame.image))
            yield file
        if left:
            raise InputError(f"{video.name}: frame {min(left)}: {film.problem(min(left))}; choose other frames")


def write_new(path: Path, data: bytes) -> None:
    """Write an image, whole or not at all, unless it is there already."""
    if path.exists():
        if path.read_bytes() == data:
            return
        raise InputError(
            f"{path}: expected no such file, or one with this frame, found another image; rename it, or remove it"
        )
    write_output(path, data)


def _files(video: Path, out: Path, score: FrameScore) -> tuple[Path, Path]:
    name = f"{video.stem}_frame_{score.index:06d}"
    return out / f"{name}.png", out / f"{name}_masked.png"


def _encoded_masked(picture: np.ndarray, mask: np.ndarray) -> bytes:
    return encode_png(np.dstack([picture, np.where(mask, 255, 0).astype(np.uint8)]))


def _tiles(picture: np.ndarray, mask: np.ndarray, score: FrameScore, rank: int) -> list[np.ndarray]:
    """The frame with its number, and the frame with what is masked in a colour that tissue never has."""
    small = downscaled(picture.astype(np.float32) / 255, TILE_WIDTH)
    share = downscaled(mask[..., None].astype(np.float32), TILE_WIDTH)
    masked = small * share + (1 - share) * (0.35 * small + 0.65 * MASKED_COLOUR)
    text = f"{rank}: frame {score.index}, {score.time_s:.2f} s, score {score.total:.2f}"
    size = small.shape[1] / 1000
    labelled = np.ascontiguousarray(small)
    scale, thickness, margin = 1.3 * size, max(1, round(2 * size)), round(12 * size)
    (wide, high), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, thickness)
    labelled[: high + below + 2 * margin, : wide + 2 * margin] *= 0.25
    cv2.putText(
        labelled,
        text,
        (margin, margin + high),
        cv2.FONT_HERSHEY_SIMPLEX,
        scale,
        (1.0, 1.0, 1.0),
        thickness,
        cv2.LINE_AA,
    )
    return [labelled, masked]


def _rows(frames: Sequence[FrameScore], chosen: Sequence[int]) -> list[tuple[object, ...]]:
    ranks = {index: rank for rank, index in enumerate(chosen, start=1)}
    return [
        (
            each.index, f"{each.time_s:.4f}", ranks.get(each.index, ""), f"{each.total:.4f}", f"{each.sharpness:.4f}",
            f"{each.exposure:.3f}", f"{each.glare:.4f}", f"{each.obstructed:.4f}", f"{each.motion_px:.2f}",
            f"{each.comb:.3f}",
        )
        for each in frames
    ]  # fmt: skip


def report_lines(video: Path, scores: FilmScores, chosen: int, wanted: int) -> list[str]:
    """What was read, and what the user should know about it."""
    frames, info = scores.frames, scores.info
    width, height = info.size_wh
    lines = [
        f"{video.name}: {width}x{height} px, {_counted(len(frames), 'frame')} from {frames[0].time_s:.2f} s to "
        f"{frames[-1].time_s:.2f} s"
    ]
    lines += film_notes(scores)
    if chosen < wanted:
        lines.append(
            f"note: {chosen} of {wanted} frames {'is' if chosen == 1 else 'are'} written; no others are different and "
            "nearly as good, see scores.csv"
        )
    return lines


def film_notes(scores: FilmScores) -> list[str]:
    """What the user should know about a film before a frame of it is taken."""
    frames, info, lines = scores.frames, scores.info, list[str]()
    if len(frames) < info.frames:
        lines.append(
            f"note: {len(frames)} of {info.frames} frames are used: the file is damaged or cut off, or the others have "
            f"another size"
        )
    elif scores.broken and not info.cut_off:
        lines.append("note: the file is damaged or cut off; the frames that can be decoded are used")
    lines += [f"note: {note}" for note in info.notes]
    combed = float(np.mean([each.comb > COMBED for each in frames]))
    if combed > INTERLACED_SHARE:
        lines.append(f"note: the video is interlaced: {combed:.0%} of its frames show two moments; {DEINTERLACE}")
    best = max(each.total for each in frames)
    if best < DOUBTFUL:
        lines.append(
            f"note: the best frame scores {best:.2f} of 1: no frame is sharp, still and uncovered at once; look at it "
            "before you use it"
        )
    return lines


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def frame_line(rank: int, frame: ChosenFrame) -> str:
    """One chosen frame."""
    score = frame.score
    return (
        f"{rank}. {frame.image.name}: {score.time_s:.2f} s, score {score.total:.2f}, sharpness {score.sharpness:.2f}, "
        f"covered {score.obstructed:.1%}, glare {score.glare:.1%}, masked {1 - frame.tissue:.1%}"
    )
