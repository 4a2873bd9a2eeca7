"""The whole command on the sample at 64 px, and what its folder promises."""

import csv
import json
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.blender.sample.sample_case import write_sample_case
from oneframe.evaluation.view_scores import SCORES
from oneframe.images.image_reader import read_image
from oneframe.sample.temporal_bone import MICROSCOPE, sample_surface

pytestmark = [pytest.mark.long, pytest.mark.render]
METHODS = "ours, projective, cycles", "ours, projective, fill, cycles", "paper's colours (Cycles)"


@pytest.fixture(scope="module")
def sample(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sample")
    for _ in write_sample_case(folder, sample_surface(spacing_mm=0.8), camera=MICROSCOPE.resized(64, 48)):
        pass
    return folder


def test_the_folder_of_an_evaluation(sample, tmp_path, run_oneframe):
    out = tmp_path / "evaluation"
    listed = json.loads((sample / "held_out.json").read_text())[:2]
    # one photograph looks away, and the frame itself is one of them
    listed[1]["cam_from_mesh"] = (np.eye(4, k=3) * 1e4 + np.array(listed[1]["cam_from_mesh"])).tolist()
    case_pose = tomllib.loads((sample / "case.toml").read_text())["pose"]["cam_from_mesh"]
    listed.append({"image": "frame.png", "cam_from_mesh": case_pose})
    # and its middle half with twice the zoom, which is one of two cameras of a file
    frame, k = cv2.imread(str(sample / "frame.png")), MICROSCOPE.resized(64, 48).k
    cv2.imwrite(str(sample / "tele.png"), cv2.resize(frame[12:36, 16:48], (64, 48), interpolation=cv2.INTER_LINEAR))
    tele = np.array([[2, 0, -31.5], [0, 2, -23.5], [0, 0, 1]]) @ k
    cameras = {place: {"cam_K": matrix.ravel().tolist()} for place, matrix in (("0", k), ("1", tele))}
    (sample / "scene_camera.json").write_text(json.dumps(cameras))
    listed.append({"image": "tele.png", "cam_from_mesh": case_pose, "camera": "scene_camera.json#1"})
    (sample / "list.json").write_text(json.dumps(listed))
    arguments = [
        sample / "case.toml", sample / "list.json", "--case", sample / "case.toml", sample / "list.json",
        "--methods", "projective-cycles", "projective-fill-cycles", "paper-cycles", "--out", out,
    ]  # fmt: skip
    ended = run_oneframe("evaluate", *arguments)
    assert ended.returncode == 0, ended.stderr
    assert "photograph_2 shows nothing of the surface" in ended.stdout
    # what is written is there, and nothing else
    assert {path.name for path in out.iterdir()} == {"frames.csv", "summary.md", "figure.png"}
    assert not [path for path in out.iterdir() if str(sample).encode() in path.read_bytes()]
    table = [line for line in (out / "frames.csv").read_text().splitlines() if not line.startswith("# ")]
    written = list(csv.DictReader(table))
    assert len(written) == 2 * 4 * 3
    name = written[0]["case"]
    rows = {(row["image"], row["method"]): row for row in written if row["case"] == name}
    # the frame itself comes back, all of it that the frame saw
    own = {score: float(rows["photograph_3", METHODS[0]][score]) for score in SCORES}
    assert own["ssim_observed"] > 0.999
    assert own["error_observed"] < 0.5
    assert own["angle_deg"] < 0.01
    assert float(rows["photograph_4", METHODS[0]]["error_observed"]) < 4
    assert 12 <= float(rows["photograph_1", METHODS[0]]["angle_deg"]) <= 20
    assert not any(rows["photograph_2", METHODS[0]][score] for score in SCORES if score.startswith("ssim"))
    filled, grey = (rows["photograph_1", method] for method in (METHODS[1], METHODS[0]))
    assert filled["observed_px"] == grey["observed_px"]
    assert float(filled["error_surface"]) < float(grey["error_surface"])
    summary = (out / "summary.md").read_text()
    shown = [f"photograph_{number}" for number in (1, 3, 4)]
    scores = [float(rows[image, METHODS[0]]["ssim_whole"]) for image in shown]
    assert f"{np.mean(scores):.3f} [" in summary
    assert summary.count("## ") == 3
    # six photographs side by side; real, segmented and three methods below each other
    height, width = read_image(out / "figure.png")[0].shape[:2]
    assert width == pytest.approx(6 * 324, abs=8)
    assert height == pytest.approx(5 * 244, abs=8)
    # the same command replaces its own files
    again = run_oneframe("evaluate", *arguments)
    assert again.returncode == 0, again.stderr
