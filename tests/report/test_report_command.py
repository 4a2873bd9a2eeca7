"""The command that writes a page, and the size of what it writes."""

import json
import re

import cv2
import numpy as np

from oneframe.dataset.layout import ViewPaths
from oneframe.report.dataset_page import FRAME_BYTES, dataset_page
from oneframe.report.page import asset
from oneframe.report.surface_sides import SIDE_PX
from oneframe.report.thumbnails import PAGE_BYTES


def test_pages_and_what_is_refused(run_oneframe, evaluation, dataset, tmp_path):
    out = tmp_path / "new" / "page.html"
    for _ in range(2):
        # the second time it replaces its own page
        ended = run_oneframe("report", evaluation, "--out", out)
        assert (ended.returncode, ended.stderr) == (0, "")
        assert ended.stdout.endswith(f"MB: {out}\n")
    refused = {
        (tmp_path, "--out", out): "expected the folder of a dataset or of an evaluation, found neither",
        (evaluation, "--out", evaluation / "evaluation.json"): "an input",
        (dataset, "--out", dataset / "report.html"): "expected a file outside the folder of the dataset",
        (evaluation, "--out", out, "--views", "-1"): "expected 0 or more",
    }
    for arguments, message in refused.items():
        ended = run_oneframe("report", *arguments)
        assert ended.returncode == 2
        assert message in ended.stderr
        assert ended.stderr.count("\n") == 1


def test_the_page_has_room_for_1000_views(dataset, tmp_path, rng):
    """A thousandth of the room for each view, however hard its picture is to encode: half of these are noise."""
    count = 8
    content = json.loads((dataset / "dataset.json").read_text())
    (tmp_path / "dataset.json").write_text(json.dumps(content | {"count": count}))
    for index in range(count):
        image = rng.integers(0, 256, (480, 640, 3), np.uint8)
        # where the pilots look, there is nothing
        image = image if index % 2 else np.full_like(image, 90)
        path = ViewPaths(tmp_path, index).file("rgb")
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, 0])
    page = dataset_page(tmp_path, most_bytes=PAGE_BYTES * count // 1000)
    pictures = re.findall(rb'"picture":"([^"]*)"', page)
    assert len(pictures) == count
    assert sum(map(len, pictures)) <= PAGE_BYTES * count // 1000
    bare = len(page) - sum(map(len, pictures))
    # script, style and 1000 records beside the pictures, the frame with its overlay, and the surface
    surface = 2 * SIDE_PX**2 * 4 / 3
    assert PAGE_BYTES + bare + 1000 * 600 + 2 * FRAME_BYTES + surface < 20e6


def test_all_text_is_readable():
    """WCAG 2.1, 1.4.3: 4.5 to 1 for text on what it stands on."""

    def luminance(code: str) -> float:
        parts = np.array([int(code[at : at + 2], 16) for at in (1, 3, 5)]) / 255
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    rules = re.findall(r"\{ (color-scheme:[^}]*)\}", asset("report.css"))
    # light, dark, and dark as the user chose it
    assert rules[1] == rules[2]
    for rule in rules:
        colours = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", rule))
        for text in ("text", "muted", "ours", "peer", "alert"):
            for below in ("background", "raised"):
                high, low = sorted((luminance(colours[text]), luminance(colours[below])), reverse=True)
                assert (high + 0.05) / (low + 0.05) >= 4.5, (text, below, rule)
