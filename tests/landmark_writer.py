"""Landmarks as a spreadsheet or a program writes them."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path

from oneframe.case.landmarks import COLUMNS, Landmark
from oneframe.files.numbers import length_text


def write_landmarks(path: Path, landmarks: Sequence[Landmark], *, mm_per_unit: float = 1.0) -> None:
    """Write ``*.csv`` or ``*.json``; points are in mm."""
    lengths = [[length_text(value, mm_per_unit) for value in each.point or ()] for each in landmarks]
    if path.suffix.lower() == ".csv":
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            for each, point in zip(landmarks, lengths, strict=True):
                writer.writerow([each.name, *(point or [""] * 3), *(each.pixel or [""] * 2), str(each.enabled).lower()])
        return
    entries = []
    for each, point in zip(landmarks, lengths, strict=True):
        parts = [f'"name": {json.dumps(each.name)}', f'"enabled": {json.dumps(each.enabled)}']
        parts += [f'"surface": [{", ".join(point)}]'] if point else []
        parts += [f'"pixel": {json.dumps(each.pixel)}'] if each.pixel is not None else []
        entries.append(f"{{{', '.join(parts)}}}")
    path.write_text(f"[{', '.join(entries)}]", encoding="utf-8")
