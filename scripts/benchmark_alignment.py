"""Measure the pose solver: accuracy against Vision6D's, coverage of the 95 % region, wrong pairs, time.

    python scripts/benchmark_alignment.py [--trials 2000] [--noise-px 2] [--case CASE.toml] [--out FILE]

Trials: a microscope (f = 12 800 px, 300 mm), points in 30x20x12 mm, rotations uniform over SO(3); with --case also
the surface that the case's frame shows, at its pose. Errors: the angle of the rotation, and the mean displacement of
the whole surface in the image. Refused trials count in "all" with their best guess. The solver is told of 2 px always.
Times are of one processor core.
"""

import os
import sys
from pathlib import Path

# one thread: the figures are of the solver, not of the machine
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# the repository's root: scripts are run from a checkout
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import json
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress

import cv2
import numpy as np

from pipeline.alignment.landmarks.solver import UndeterminedPose, solve_pose
from pipeline.blender.case.load_case import load_case
from pipeline.blender.colour.reference_view import reference_view_of
from pipeline.blender.command_line import ArgumentParser, own_output, run_script
from pipeline.camera.pinhole import PinholeCamera
from pipeline.case.case_file import read_case
from pipeline.evaluation.landmark_trials import MICROSCOPE, Errors, Trial, box_trial, run_trials, surface_trial

STATED_SIGMA_PX = 2.0
COUNTS = (4, 6, 8, 10)


def main(argv: Sequence[str]) -> int:
    parser = ArgumentParser(prog="benchmark_alignment.py", description=__doc__.splitlines()[0])
    parser.add_argument("--trials", metavar="N", type=int, default=2000)
    parser.add_argument("--noise-px", metavar="X", type=float, nargs="+", default=[1.0, 2.0, 4.0], help="of the clicks")
    parser.add_argument("--case", metavar="CASE.toml", type=Path)
    parser.add_argument("--out", metavar="FILE", type=Path, help="all figures as JSON")
    arguments = parser.parse(argv)
    cv2.setNumThreads(1)
    output = own_output()

    def report(line: str) -> None:
        output.write(line + "\n")
        output.flush()

    figures: dict[str, object] = {"trials": arguments.trials}
    report(f"accuracy, {arguments.trials} trials each: rotation deg / surface px, median (95 %)")
    figures["box"] = measured(box_trials, MICROSCOPE, arguments.trials, arguments.noise_px, report)
    if arguments.case:
        source = reference_view_of(load_case(read_case(arguments.case)))
        seen = source.view.observed(source.mesh.vertices, source.mesh.vertex_normals)
        visible, camera = source.mesh.vertices[seen], source.view.camera

        def case_trials(rng: np.random.Generator, count: int, sigma_px: float) -> Callable[[], Trial]:
            return lambda: surface_trial(
                rng, count, sigma_px, camera=camera, cam_from_model=source.view.cam_from_model, visible_points=visible
            )

        report(f"the same for {arguments.case.name}: {seen.sum()} of {len(seen)} vertices seen")
        figures["case"] = measured(case_trials, camera, arguments.trials, arguments.noise_px, report)
    figures["wrong pairs"] = measured_outliers(max(arguments.trials // 10, 20), report)
    figures["time"] = measured_time(report)
    if arguments.out:
        arguments.out.write_text(json.dumps(figures, indent=2) + "\n")
    return 0


def box_trials(rng: np.random.Generator, count: int, sigma_px: float) -> Callable[[], Trial]:
    return lambda: box_trial(rng, count, sigma_px)


def measured(
    trials_of: Callable[[np.random.Generator, int, float], Callable[[], Trial]],
    camera: PinholeCamera,
    trials: int,
    noise_px: Sequence[float],
    report: Callable[[str], None],
) -> list[dict[str, object]]:
    """Accuracy and coverage for every number of pairs and every true noise; the solver is always told the same."""
    rows = []
    for sigma_px in noise_px:
        for count in COUNTS:
            draw = trials_of(np.random.default_rng([count, int(10 * sigma_px)]), count, sigma_px)
            ours, peers = run_trials(draw, trials, camera=camera, click_sigma_px=STATED_SIGMA_PX)
            refused = Counter(refusal for refusal in ours.refusals if refusal is not None)
            accepted, everything = figures_of(ours, True), figures_of(ours, False)
            theirs = {name: figures_of(errors, False) for name, errors in peers.items()}
            rows.append(
                {
                    "pairs": count,
                    "sigma_px": sigma_px,
                    "accepted": accepted,
                    "all": everything,
                    "peers": theirs,
                    "refused": dict(refused),
                    "coverage": ours.coverage,
                }
            )
            report(
                f"  {count:2d} pairs, {sigma_px:g} px: accepted {in_words(accepted)}; all {in_words(everything)}; "
                + "".join(f"{name} {in_words(each)}; " for name, each in theirs.items())
                + f"coverage {ours.coverage:.1%}; refused {refused.total()} {dict(refused)}"
            )
    return rows


def figures_of(errors: Errors, accepted: bool) -> dict[str, tuple[float, float]]:
    """Median and 95 %."""
    return {
        "rotation_deg": errors.quantiles(errors.rotation_deg, accepted=accepted),
        "surface_px": errors.quantiles(errors.mesh_px, accepted=accepted),
    }


def in_words(figures: dict[str, tuple[float, float]]) -> str:
    (turn, most_turn), (shift, most_shift) = figures["rotation_deg"], figures["surface_px"]
    return f"{turn:.2f} ({most_turn:.2f}) / {shift:.2f} ({most_shift:.2f})"


def measured_outliers(trials: int, report: Callable[[str], None]) -> list[dict[str, object]]:
    """How often exactly the wrong pairs are left out."""
    rows = []
    for count, wrong, shift_px in ((6, 0, 0), (6, 1, 40), (8, 2, 60), (10, 3, 60), (20, 0, 0), (20, 8, 80)):
        rng, outcomes = np.random.default_rng([count, wrong]), Counter[str]()
        for _ in range(trials):
            trial = box_trial(rng, count, STATED_SIGMA_PX)
            bad = rng.choice(count, wrong, replace=False)
            pixels, angle = trial.pixels.copy(), rng.uniform(0, 2 * np.pi, wrong)
            pixels[bad] += shift_px * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            try:
                inliers = solve_pose(trial.points_model, pixels, MICROSCOPE).inliers
            except UndeterminedPose as refusal:
                outcomes[f"refused: {refusal.kind}"] += 1
            else:
                outcomes["exact" if set(np.flatnonzero(~inliers)) == set(bad) else "not exact"] += 1
        rows.append({"pairs": count, "wrong": wrong, "shift_px": shift_px, "outcomes": dict(outcomes)})
        report(f"  {wrong} of {count} pairs wrong by {shift_px} px: {dict(outcomes)} of {trials}")
    return rows


def measured_time(report: Callable[[str], None]) -> list[dict[str, float]]:
    """Milliseconds a solve."""
    rows = []
    for count, wrong in ((4, 0), (6, 0), (10, 0), (20, 0), (10, 2), (20, 4)):
        rng, times = np.random.default_rng(count), []
        for _ in range(60):
            trial = box_trial(rng, count, STATED_SIGMA_PX)
            trial.pixels[:wrong] += 80
            start = time.process_time()
            with suppress(UndeterminedPose):
                solve_pose(trial.points_model, trial.pixels, MICROSCOPE)
            times.append((time.process_time() - start) * 1e3)
        median, most = float(np.median(times)), float(np.quantile(times, 0.95))
        rows.append({"pairs": count, "wrong": wrong, "median_ms": median, "most_ms": most})
        report(f"  {count} pairs, {wrong} wrong: {median:.1f} ms, 95 % below {most:.1f} ms")
    return rows


if __name__ == "__main__":
    run_script(main)
