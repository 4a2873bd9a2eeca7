"""The table "What it can take" in docs/limits.md: its numbers are the code's, and both sides of every limit hold."""

import importlib
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import bpy
import numpy as np
import pytest

from oneframe.alignment.landmarks.covariance import pose_uncertainty
from oneframe.alignment.landmarks.degeneracy import UndeterminedPose, check_uncertainty
from oneframe.alignment.landmarks.solver import solve_pose
from oneframe.alignment.pose_uncertainty import PoseMode
from oneframe.alignment.refinement import refine
from oneframe.alignment.reprojection import Correspondences
from oneframe.blender.bridge.camera import new_camera
from oneframe.blender.dataset import view_renderer
from oneframe.blender.dataset.job import Job, open_job
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import read_case
from oneframe.case.loaded_case import load_case
from oneframe.case.pose_record import PoseRecord
from oneframe.colour.colour_doubts import magnification_doubt, pose_doubt, reduction_doubt
from oneframe.colour.seen_frame import SeenFrame
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.run_folder import Shard
from oneframe.errors import InputError
from oneframe.poses.constraints import Constraints, ViewStatistics, plan_pose, sampling_doubt
from oneframe.surface.mesh import checked_mesh
from oneframe.transforms import rigid, rotation_from_vector, transform_points
from scripts.benchmarks.sweeps.camera import Place, write_place
from scripts.benchmarks.sweeps.landmarks import Clicks, camera_of, draw_trial
from tests.alignment.test_refinement import CAMERA, TRUE_POSE, VALID, hills, photograph

PAGE = Path(__file__).resolve().parents[2] / "docs" / "limits.md"
ROW = re.compile(r"^\| ([^|]+) \| ([^|]+) \| (\w+) \| `(\w+)` \(`([\w.]+)`\) \| `(\w+)` \|$", re.MULTILINE)
ROWS = ROW.findall(PAGE.read_text(encoding="utf-8"))
IDS = [f"{module.rpartition('.')[2]}.{name}" for *_, name, module, _ in ROWS]


def number_of(text: str) -> float:
    """The first number of a cell, without the spaces between thousands; percent as a fraction."""
    found = re.match(r"[\d .]*\d", text)[0]
    return float(found.replace(" ", "")) * (0.01 if text[len(found) :].startswith(" %") else 1)


def test_the_table_says_what_the_code_does():
    table = PAGE.read_text(encoding="utf-8").split("| quantity |")[1]
    assert len(ROWS) == len([line for line in table.splitlines() if line.startswith("| ")]) >= 28
    for name, (_, works, _, constant, module, _) in zip(IDS, ROWS, strict=True):
        assert number_of(works) == pytest.approx(getattr(importlib.import_module(module), constant), rel=1e-5), name


# --- the answers, by limit -------------------------------------------------------------------------------------------


def solved(points: np.ndarray, pixels: np.ndarray, camera: PinholeCamera, words: str, sigma_px: float = 2.0) -> str:
    """The answer of the solver; a warning counts only if it has these words."""
    try:
        estimate = solve_pose(points, pixels, camera, click_sigma_px=sigma_px)
    except UndeterminedPose:
        return "refused"
    return "warned" if any(words in message for message in estimate.messages) else "works"


def clicked(clicks: Clicks, focal_px: float = 600.0, words: str = "") -> str:
    camera = camera_of(focal_px)
    trial = draw_trial(np.random.default_rng(3), clicks, camera)
    return solved(trial.points_model, trial.pixels, camera, words or "no such words")


def pairs(count: float) -> str:
    return clicked(Clicks(count=round(count)), words="rests on")


def noise(ratio: float) -> str:
    return clicked(Clicks(count=40, sigma_px=2 * ratio), words="residuals are larger")


def inliers(part: float) -> str:
    return clicked(Clicks(count=20, outliers=1 - part))


def rotation(value: float) -> str:
    """Exact clicks of which the stated noise is such that a rotation has this standard deviation."""
    camera = camera_of(600.0)
    trial = draw_trial(np.random.default_rng(5), Clicks(count=12, sigma_px=0.0), camera)
    return _uncertain(trial.points_model, trial.cam_from_model, camera, value, "largest_rotation_deg")


def depth(value: float) -> str:
    """The same for the distance: the points are spread along the line of sight, so rotations are known better."""
    points = (np.random.default_rng(6).random((12, 3)) - 0.5) * [10, 10, 60]
    return _uncertain(points, rigid(translation=np.array([0.0, 0, 640])), camera_of(12_800.0), value, "relative_depth")


def _uncertain(points: np.ndarray, pose: np.ndarray, camera: PinholeCamera, value: float, quantity: str) -> str:
    pixels = camera.project(transform_points(pose, points))
    known = solve_pose(points, pixels, camera, click_sigma_px=0.1).uncertainty
    return solved(points, pixels, camera, "pose is uncertain", 0.1 * value / getattr(known, quantity))


def refused_depth(value: float) -> str:
    """Rotations are refused before the distance is this uncertain, so the check gets a covariance of its own."""
    points = (np.random.default_rng(6).random((12, 3)) - 0.5) * 30
    pose, camera = rigid(translation=np.array([0.0, 0, 640])), camera_of(12_800.0)
    pairs = Correspondences.about(points, camera.project(transform_points(pose, points)), camera)
    known = pose_uncertainty(pairs, pose, 1e-6)
    covariance = known.covariance.copy()
    covariance[2, 2] = (value * 640) ** 2
    mode = PoseMode(pose, replace(known, covariance=covariance), 1.0, np.ones(len(pairs), bool))
    return refusal(lambda: check_uncertainty(pairs, mode, 2.0))


def collinear(ratio: float) -> str:
    """Refused as a line, or by its uncertainty: the reason tells."""
    points = np.linspace([-10.0, 0, 0], [10.0, 0, 0], 8)
    points[:, 1] = ratio * points[[3, 0, 6, 1, 7, 2, 5, 4], 0]
    # across: the points' second singular value over their first
    values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    points[:, 1] *= ratio * values[0] / values[1]
    pose = rigid(rotation_from_vector(np.array([0.4, 0.3, 0.1])), np.array([0.0, 0, 60]))
    camera = camera_of(1600)
    with pytest.raises(UndeterminedPose) as found:
        solve_pose(points, camera.project(transform_points(pose, points)), camera)
    return "refused" if "on one line, about which" in str(found.value) else "works"


def before_a_wall() -> SeenFrame:
    """At 100 mm, by a lens of 300 px."""
    camera = PinholeCamera(64, 48, 300.0, 300.0, 31.5, 23.5)
    everywhere, inverse = np.ones((48, 64), bool), np.full((48, 64), 0.01, np.float32)
    return SeenFrame(np.zeros((48, 64, 3), np.float32), everywhere, camera, rigid(), inverse_depth=inverse)


def facing(angle_deg: float) -> str:
    normal = rotation_from_vector(np.array([np.radians(angle_deg), 0, 0])) @ [0, 0, -1.0]
    return "works" if before_a_wall().facing(np.array([[0, 0, 100.0]]), normal[None])[0] else "grey"


def below(footprints: float) -> str:
    return "works" if before_a_wall().unoccluded(np.array([[0, 0, 100 * (1 + footprints / 300)]]))[0] else "grey"


def said(message: str) -> str:
    return "warned" if message else "works"


def principal_point(sizes: float) -> str:
    k = [[900.0, 0, 320 + 640 * sizes], [0, 900.0, 240 - 480 * sizes], [0, 0, 1]]
    return refusal(lambda: PinholeCamera.from_matrix(k, size=(640, 480)))


def refusal(call: Callable[[], object]) -> str:
    try:
        call()
    except InputError:
        return "refused"
    return "works"


def in_blender(camera: PinholeCamera) -> str:
    scene = bpy.data.scenes.new("limits")
    try:
        return refusal(lambda: new_camera(scene, camera, clip_mm=(1, 1000)))
    finally:
        bpy.data.scenes.remove(scene)


def aspect(ratio: float) -> str:
    either = {in_blender(PinholeCamera(64, 48, *pair, 31.5, 23.5)) for pair in ((ratio * 10, 10.0), (10.0, ratio * 10))}
    return either.pop() if len(either) == 1 else "differs"


def side(px: float) -> str:
    return in_blender(PinholeCamera(64, round(px), 100.0, 100.0, 31.5, 1.0))


@pytest.fixture
def placed(tmp_path: Path) -> Callable[[Place], str]:
    """Loads a case of files with a triangle there: the answer."""

    def answer(place: Place) -> str:
        try:
            messages = load_case(read_case(write_place(tmp_path, place, 0.3)[0])).messages
        except InputError:
            return "refused"
        return "warned" if any("single precision" in message for message in messages) else "works"

    return answer


def _long(focal_px: float) -> Place:
    return Place(PinholeCamera(640, 480, focal_px, focal_px, 320, 240), distance_mm=15 * focal_px / 640)


def _far_origin(error_px: float) -> Place:
    """Half a step of single precision at the largest coordinate is this many pixels."""
    farthest = error_px * 2**24 * 300 / 12_800
    return Place(PinholeCamera(640, 480, 12_800.0, 12_800.0, 320, 240), offset_mm=1.2 * farthest)


def _extent(ratio: float) -> Place:
    return Place(PinholeCamera(640, 480, 3200.0, 3200.0, 320, 240), reach=ratio * 640 / 3200 / 2)


def _away(distance_mm: float) -> Place:
    return Place(PinholeCamera(640, 480, 3200.0, 3200.0, 320, 240), distance_mm=distance_mm)


def triangles(count: float) -> str:
    faces = np.broadcast_to(np.array([[0, 1, 2]], np.int32), (round(count), 3))
    # a face too many is refused before anything is computed; at the limit that would take seconds
    return refusal(lambda: checked_mesh(np.eye(3), faces if count > 1e7 else faces[:1000], "surface.ply"))


class Rarely:
    """Accepted at one attempt of a view alone: the number of the pose is in it."""

    def __init__(self) -> None:
        self.drawn = 0

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        self.drawn += 1
        return rigid(translation=np.array([float(self.drawn), 0, 0]))


def attempts(number: float) -> str:
    def probe(pose: np.ndarray) -> ViewStatistics:
        return ViewStatistics(float(pose[0, 3] == round(number)), 1.0, 100.0)

    return refusal(lambda: plan_pose(Rarely(), Constraints(min_surface=0.5), probe, seed=0, index=0))


ANSWERS: dict[str, tuple[Callable[[float], str], float]] = {
    "degeneracy.FEWEST_CORRESPONDENCES": (pairs, 0.75),
    "solver.FEW_CORRESPONDENCES": (pairs, 0.84),
    "solver.LARGE_NOISE_RATIO": (noise, 1.25),
    "degeneracy.MAX_NOISE_RATIO": (noise, 1.25),
    "degeneracy.MIN_INLIER_FRACTION": (inliers, 0.91),
    "solver.UNCERTAIN_ROTATION_DEG": (rotation, 1.05),
    "degeneracy.MAX_ROTATION_DEG": (rotation, 1.05),
    "solver.UNCERTAIN_RELATIVE_DEPTH": (depth, 1.05),
    "degeneracy.MAX_RELATIVE_DEPTH": (refused_depth, 1.05),
    "degeneracy.COLLINEAR_RATIO": (collinear, 0.99),
    "seen_frame.MAX_INCIDENCE_DEG": (facing, 1.001),
    "seen_frame.TOLERANCE_PX": (below, 1.02),
    "colour_doubts.MAX_STATED_ERROR_PX": (lambda value: said(pose_doubt(PoseRecord(error_px=value))), 1.001),
    "colour_doubts.MAX_MAGNIFICATION": (lambda value: said(magnification_doubt(value, 2.0, 0.5)), 1.001),
    "colour_doubts.MAX_REDUCTION": (lambda value: said(reduction_doubt(2.0, value, 2.0, 1)), 1.001),
    "pinhole.FARTHEST_PRINCIPAL_POINT": (principal_point, 1.001),
    "camera.MAX_PIXEL_ASPECT": (aspect, 1.001),
    "camera.SMALLEST_VIEW_PX": (side, 0.75),
    "mesh.MOST_FACES": (triangles, 1.0000001),
    "constraints.LEAST_ACCEPTANCE": (lambda value: said(sampling_doubt([round(1e4 / value)] + [0] * 9999)), 0.99),
    "constraints.MAX_ATTEMPTS": (attempts, 1.0002),
}
"""By limit: the answer to a value, and the smallest factor to a value that is beyond the limit."""
PLACES: dict[str, tuple[Callable[[float], Place], float]] = {
    "surface_doubts.LONGEST_EXACT_FOCAL_PX": (_long, 1.02),
    "surface_doubts.EXACT_PX": (_far_origin, 1.05),
    "loaded_case.MAX_EXTENT_RATIO": (_extent, 1.02),
    "surface_doubts.NEAREST_MM": (_away, 0.97),
    "surface_doubts.FARTHEST_MM": (_away, 1.03),
}
ELSEWHERE = {"verdict.MAX_ROTATION_DEG", "refine.MIN_CONTRAST"}
"""Limits of the refinement: tests/alignment/test_refinement.py, and below."""


def limit_of(name: str) -> tuple[float, str]:
    """Value of a limit of the table, and what is beyond it."""
    (row,) = (row for row, key in zip(ROWS, IDS, strict=True) if key == name)
    return getattr(importlib.import_module(row[4]), row[3]), row[2]


def test_every_limit_is_tried():
    assert sorted(IDS) == sorted({*ANSWERS, *PLACES, *ELSEWHERE})


@pytest.mark.parametrize("name", ANSWERS)
def test_both_sides_of_a_limit(name):
    answer, factor = ANSWERS[name]
    limit, beyond = limit_of(name)
    assert answer(limit * factor) == beyond
    # inside a limit that refuses there may be one that warns
    inside = answer(limit if round(limit) == limit and factor in (0.75, 0.84) else limit / factor)
    assert inside == "works" or (beyond == "refused" and inside == "warned")


@pytest.mark.parametrize("name", PLACES)
def test_both_sides_of_a_limit_on_the_place(name, placed):
    place, factor = PLACES[name]
    limit, beyond = limit_of(name)
    assert placed(place(limit * factor)) == beyond
    assert placed(place(limit / factor)) == "works"


class Searching(Exception):
    """The refinement went on to its search."""


def test_both_sides_of_the_least_contrast(monkeypatch):
    limit, beyond = limit_of("refine.MIN_CONTRAST")
    mesh, contrast, measured = hills(1), refine.contrast, []
    frame = photograph(mesh)
    monkeypatch.setattr(refine, "contrast", lambda level: measured.append(contrast(level)) or measured[-1])

    def stop(fraction: float) -> None:
        if fraction > 0:
            raise Searching

    def answer(gain: float) -> str:
        try:
            refined = refine.refine_pose(0.5 + gain * (frame - 0.5), VALID, CAMERA, mesh, TRUE_POSE, progress=stop)
        except Searching:
            return "works"
        return "refused" if "no detail" in refined.message else "differs"

    assert answer(1.0) == "works"
    to_limit = limit / measured[0]
    assert answer(1.05 * to_limit) == "works"
    assert answer(to_limit / 1.05) == beyond


def test_a_run_says_beforehand_what_it_knows(write_tiny_case, tmp_path, monkeypatch):
    case = read_case(write_tiny_case(tmp_path / "case"))

    def messages(**options: object) -> str:
        job = Job(case, tmp_path / "out", DatasetOptions(**options), Shard())
        with open_job(job).renderer(threads=1) as renderer:
            return " ".join((*renderer.messages, renderer.sampling_doubt()))

    assert messages() == ""
    assert "views enlarge the frame up to 8 times" in messages(scale=4.0, distance_min=0.5)
    far = {"scale": 0.25, "distance_max": 3.0, "min_surface": 0.0}
    assert "views reduce the frame up to 12 times" in messages(**far)
    assert "reduce" not in messages(**far, samples=4)
    monkeypatch.setattr(view_renderer, "Constraints", partial(Constraints, max_attempts=50))
    with pytest.raises(InputError, match="of 50 poses tried, 50 came nearer"):
        messages(min_clearance_mm=1e6)
