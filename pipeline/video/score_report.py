"""What the selection says about a film, in sentences."""

from pathlib import Path

import numpy as np

from .frame_folder import ChosenFrame
from .frame_scores import COMBED, FilmScores

DOUBTFUL = 0.3
"""Score of the best frame below which a film shows nothing well: noise, or one view after the other."""

INTERLACED_SHARE = 0.05
"""Share of the frames with combs from which on a film is called interlaced."""


def report_lines(video: Path, scores: FilmScores, chosen: int, wanted: int) -> list[str]:
    """What was read, and what the user should know about it."""
    frames, info = scores.frames, scores.info
    width, height = info.size_wh
    lines = [
        f"{video.name}: {width}x{height} px, {_counted(len(frames), 'frame')} from {frames[0].time_s:.2f} s to "
        f"{frames[-1].time_s:.2f} s, {_counted(len({each.scene for each in frames}), 'scene')}"
    ]
    if len(frames) < info.frames:
        lines.append(
            f"note: the file is damaged or cut off: {len(frames)} of {info.frames} frames can be decoded; they are used"
        )
    elif info.missing_s > 0:
        lines.append(
            f"note: the file is cut off: it ends {info.missing_s:.1f} s before its header says; what is there is used"
        )
    if scores.circle is not None:
        circle = scores.circle
        lines.append(
            f"circle of the view: centre {circle.u:.1f}, {circle.v:.1f}, radius {circle.radius:.1f} px; the rest "
            "is masked"
        )
    combed = float(np.mean([each.comb > COMBED for each in frames]))
    if combed > INTERLACED_SHARE:
        lines.append(
            f"note: the video is interlaced: {combed:.0%} of its frames show two moments, and are avoided; of one that "
            "is chosen all the same, only the upper field is used, and half of the rows are interpolated"
        )
    best = max(each.total for each in frames)
    if chosen and best < DOUBTFUL:
        lines.append(
            f"note: the best frame scores {best:.2f} of 1: no view is shown sharply and for longer; look at it "
            "before you use it"
        )
    if chosen < wanted:
        lines.append(
            f"note: {chosen} of {wanted} frames {'is' if chosen == 1 else 'are'} written; no others are different and "
            "nearly as good, see scores.csv"
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
