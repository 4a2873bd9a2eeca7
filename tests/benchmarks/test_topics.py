"""The quick form of every topic runs from its command to its files, and draws the same charts from them again."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oneframe.case.case_file import read_case
from oneframe.case.case_writer import write_case
from oneframe.light.lens_light import LensLight
from oneframe.transforms import rigid

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "benchmark.py"
REGISTRATION = ("registration_grid", "stability_registration")
FORMS: dict[str, tuple[str, list[str], list[str]]] = {
    # of a topic, or its form in the light: what --out is, further arguments, and what is written besides
    "speed": ("speed.json", ["--only", "start", "--rounds", "1"], []),
    "chart": ("chart.csv", ["--without-sample", "--case", "{case}"], ["chart.png"]),
    "chart --light": (
        "chart.csv", ["--without-sample", "--case", "{case}", "{photographs}"], ["chart.png"]
    ),
    "landmarks": ("landmarks.csv", ["--trials", "4"], ["landmarks.png"]),
    "evaluation": (
        # writes the sample's case as without --light, and more
        "", ["--light", "--methods", "projective-lens-raster", "--width", "64", "--photographs", "1"],
        ["frames.csv", "figure.png"],
    ),
    "registration": (
        "", ["--only", "photographs"],
        ["registration_photographs.csv", *(f"{name}.png" for name in REGISTRATION)],
    ),
    "stability": (
        "", ["--only", "camera"], ["stability_camera.csv", "stability_camera.png"]
    ),
    "training": (
        "training.csv", ["--without-sample", "--case", "{case}", "{photographs}"],
        ["training_bad.csv", "training.png", "training_bad.png"],
    ),
}  # fmt: skip


@pytest.mark.render
@pytest.mark.parametrize("form", FORMS)
def test_a_quick_form_writes_its_files(form, tmp_path, write_tiny_case):
    topic = form.split()[0]
    name, more, written = FORMS[form]
    case, out = write_tiny_case(tmp_path / "case"), tmp_path / "out"
    photographs = tmp_path / "photographs.json"
    if topic == "training":
        pytest.importorskip("torch", reason="PyTorch is not installed")
    # not quite at its own pose, where views have no error
    pose = rigid(translation=np.array([0.5, 0.0, 0.0])) @ read_case(case).cam_from_mesh
    photographs.write_text(json.dumps([{"image": str(case.with_name("frame.png")), "cam_from_mesh": pose.tolist()}]))
    if form != topic:
        write_case(case, replace(read_case(case), light=LensLight((-13.0, -16.0, 0.0), 0.05)))
    more = [each.format(case=case, photographs=photographs) for each in more]

    def run(*flags: str) -> dict[str, bytes]:
        command = [sys.executable, SCRIPT, *form.split(), "--quick", "--out", out / name, *more, *flags]
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
        assert ended.returncode == 0, ended.stderr
        return {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}

    made = run()
    expected = {*([name] if name else []), *written}
    assert made.keys() >= expected
    assert topic == "evaluation" or made.keys() == expected
    if topic == "stability":
        assert run("--redraw") == made
