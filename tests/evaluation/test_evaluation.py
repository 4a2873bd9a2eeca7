"""The whole command on the sample at 64 px, and what its folder promises."""

import csv
import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oneframe.blender.render.engines import RENDERERS
from oneframe.blender.sample.sample_case import write_sample_case
from oneframe.evaluation import evaluate, evaluation_files
from oneframe.evaluation.conditions import Conditions
from oneframe.evaluation.evaluation_files import evaluation_run, write_evaluation
from oneframe.evaluation.finished_scores import FINISHED
from oneframe.evaluation.methods import chosen_methods
from oneframe.evaluation.record.evaluation_record import read_evaluation
from oneframe.evaluation.scores import view_scores
from oneframe.evaluation.scores.view_scores import SCORES
from oneframe.images.image_check import PNG_SIGNATURE
from oneframe.sample.temporal_bone import MICROSCOPE, sample_surface

pytestmark = [pytest.mark.long, pytest.mark.render]


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
    case_pose = read_pose(sample / "case.toml")
    listed.append({"image": "frame.png", "cam_from_mesh": case_pose})
    (sample / "list.json").write_text(json.dumps(listed))
    arguments = [
        sample / "case.toml", sample / "list.json", "--case", sample / "case.toml", sample / "list.json",
        "--methods", "projective-cycles", "projective-fill-cycles", "paper-cycles",
        "--pictures", "3", "--out", out,
    ]  # fmt: skip

    ended = run_oneframe("evaluate", *arguments)
    assert ended.returncode == 0, ended.stderr
    assert "photograph_2 shows nothing of the surface" in ended.stdout
    assert "FID and KID are missing" in ended.stdout
    record = json.loads((out / "evaluation.json").read_text())
    assert record["format"] == "oneframe evaluation 1"
    assert record["conditions"].keys() == {"machine", "versions", "configuration", "measured"}
    assert len({case["name"] for case in record["cases"]}) == 2
    ran = [method["name"] for method in record["methods"] if "skipped" not in method]
    assert ran == ["ours, projective, cycles", "ours, projective, fill, cycles", "paper's colours (Cycles)"]
    assert [method["peer"] for method in record["methods"]] == [False, False, True]
    assert record["distribution"] == []
    assert record["scores"] == SCORES
    rows = {(row["case"], row["image"], row["method"]): row for row in record["rows"]}
    assert len(rows) == 2 * 3 * 3
    name = record["cases"][0]["name"]
    # the frame itself comes back, all of it that the frame saw
    assert rows[name, "photograph_3", ran[0]]["ssim_observed"] > 0.999
    assert rows[name, "photograph_3", ran[0]]["error_observed"] < 0.5
    assert rows[name, "photograph_3", ran[0]]["angle_deg"] < 0.01
    assert 12 <= rows[name, "photograph_1", ran[0]]["angle_deg"] <= 20
    assert all(rows[name, "photograph_2", ran[0]][score] is None for score in SCORES if score.startswith("ssim"))
    filled, grey = (rows[name, "photograph_1", method] for method in (ran[1], ran[0]))
    assert filled["observed_px"] == grey["observed_px"]
    assert filled["error_surface"] < grey["error_surface"]
    # what is drawn and written is there, and nothing else
    pictures = {entry[kind] for entry in record["pictures"] for kind in ("real", "segmented", "rendered", "difference")}
    assert len(record["pictures"]) == 2 * 2 * 3
    files = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    tables = {"evaluation.json", "frames.csv", "summary.md", "summary.tex", "figure.png", "pairs.png"}
    assert files == tables | pictures | set(record["charts"])
    assert len(record["charts"]) == 2
    assert not [path for path in files if b"view_" in path.encode() + (out / path).read_bytes()]
    assert str(sample) not in (out / "evaluation.json").read_text()
    assert all((out / path).read_bytes().startswith(PNG_SIGNATURE) for path in pictures)
    table = [line for line in (out / "frames.csv").read_text().splitlines() if not line.startswith("# ")]
    written = list(csv.DictReader(table))
    assert [float(row["ssim_whole"]) for row in written if row["ssim_whole"]] == pytest.approx(
        [row["ssim_whole"] for row in record["rows"] if row["ssim_whole"] is not None], rel=1e-5
    )
    latex = (out / "summary.tex").read_text()
    assert latex.count(r"\begin{tabular}") == latex.count(r"\bottomrule") == 3
    assert "\\\\" in latex
    # means and intervals; the limit, except for what it is given
    means = {(entry["case"], entry["method"], entry["score"]): entry for entry in record["summary"]}
    both = [row["ssim_whole"] for key, row in rows.items() if key[0] == name and key[2] == ran[0] and row["ssim_whole"]]
    assert means[name, ran[0], "ssim_whole"]["mean"] == pytest.approx(np.mean(both))
    assert means["all", ran[0], "ssim_whole"]["n"] == 4
    bound = {(entry["case"], entry["score"]): entry for entry in record["bound"]}
    assert bound["all", "ssim_whole"]["mean"] > means["all", ran[0], "ssim_whole"]["mean"]
    assert ("all", "flow_px") not in bound
    assert read_evaluation(out / "evaluation.json").cases[0].frames == ("photograph_1", "photograph_2", "photograph_3")


class Killed(BaseException):
    """What nothing catches."""


def test_a_killed_evaluation_goes_on_where_it_was(sample, tmp_path, monkeypatch):
    listed = json.loads((sample / "held_out.json").read_text())[:3]
    listed[0]["cam_from_mesh"] = (np.eye(4, k=3) * 1e4 + np.array(listed[0]["cam_from_mesh"])).tolist()
    (sample / "three.json").write_text(json.dumps(listed))
    pairs, methods = [(sample / "case.toml", sample / "three.json")], ("projective-raster", "vertex-raster")
    scored = []

    def counted(*arguments):
        scored.append(1)
        return view_scores.scores_of(*arguments)

    monkeypatch.setattr(evaluate, "scores_of", counted)
    # where features come from is another matter
    monkeypatch.setattr(evaluate, "_features", lambda _, image, shown: image[::8, ::8].ravel())

    def run(out: Path, until: float = 2.0, seed: int = 0) -> int:
        scored.clear()
        prepared = evaluation_run(pairs, out, chosen_methods(methods, RENDERERS), seed=seed, pictures=1)
        prepared = replace(prepared, settings=replace(prepared.settings, inception=lambda _: None, pose_error_px=1.0))
        monkeypatch.setattr(evaluation_files, "_conditions", lambda run: Conditions("", {}, {"seed": seed}))

        def reach(done: float) -> None:
            if done > until:
                raise Killed

        write_evaluation(prepared, reach)
        return len(scored)

    def results(out: Path) -> dict[str, bytes]:
        files = {path.relative_to(out).as_posix(): path.read_bytes() for path in out.rglob("*") if path.is_file()}
        record = json.loads(files.pop("evaluation.json"))
        del record["seconds"], files["summary.md"]
        return files | {"evaluation.json": json.dumps(record).encode()}

    def killed(out: Path, share: float, seed: int = 0) -> int:
        with pytest.raises(Killed):
            run(out, share, seed)
        return len(scored)

    every, out = run(tmp_path / "whole"), tmp_path / "killed"
    early = killed(out, 0.3)
    with open(out / FINISHED, "ab") as file:
        file.write(b'{"vi\xffew": [\n["no view"]\n{"view": ["torn')
    later = killed(out, 0.75)
    assert 0 < early < early + later < every
    assert early + later + run(out) == every
    assert results(out) == results(tmp_path / "whole")
    # of other inputs nothing is taken
    assert killed(out, 0.3) == killed(out, 0.3, seed=1) == early


def read_pose(case: Path) -> list:
    return tomllib.loads(case.read_text())["pose"]["cam_from_mesh"]
