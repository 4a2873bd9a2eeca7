"""The folder of a small evaluation, with pictures of waves instead of photographs."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from oneframe.evaluation.conditions import current_conditions
from oneframe.evaluation.record.evaluation_record import (
    EVALUATION,
    Bound,
    Distribution,
    EvaluatedCase,
    EvaluatedMethod,
    Evaluation,
    Pictures,
    Row,
    evaluation_bytes,
    summarised,
)
from oneframe.evaluation.scores.view_scores import SCORES
from oneframe.images.png import encode_png

# names as long as they get
METHODS = ("ours, projective, fill, cycles", "ours, vertex, eevee", "paper's colours (Cycles)")
CASES = {"relief": ("frame_03.png", "frame_05.png", "frame_09.png"), "bone": ("view_1.png", "view_2.png")}
WIDTH, HEIGHT = 160, 120


def evaluation(cases: Mapping[str, Sequence[str]], rng: np.random.Generator) -> Evaluation:
    """Three methods on photographs of some cases, and one that was skipped."""
    rows = tuple(
        Row(case, image, method, _scores(place, rng))
        for case, images in cases.items()
        for image in images
        for place, method in enumerate(METHODS)
    )
    known = tuple(EvaluatedCase(name, tuple(images)) for name, images in cases.items())
    return Evaluation(
        conditions=current_conditions({"seed": 0}, blender="5.2.0"),
        cases=known,
        methods=(
            *(EvaluatedMethod(name, peer=name.startswith("paper")) for name in METHODS),
            EvaluatedMethod("paper (PyVista)", peer=True, skipped="PyVista is not installed"),
        ),
        rows=rows,
        summary=summarised(rows, known, rng),
        distribution=tuple(
            Distribution("all", name, 40.0 + 30 * place, True, 0.02 * (place + 1), 0.003, 5)
            for place, name in enumerate(METHODS)
        ),
        bound=tuple(Bound(case, score, 0.95, 0.94, 0.96, 1.5) for case in (*cases, "all") for score in SCORES),
    )


def write_evaluation(root: Path, rng: np.random.Generator) -> Path:
    """Write all of its files."""
    (root / "pictures").mkdir(parents=True)
    found, entries = evaluation(CASES, rng), []
    for case, images in CASES.items():
        for number, image in enumerate(images):
            stem, real, inside = f"pictures/{case}_{Path(image).stem}", _wave(number, rng), _disc()
            (root / f"{stem}_real.png").write_bytes(encode_png(real))
            (root / f"{stem}_segmented.png").write_bytes(encode_png(real * inside))
            for place, method in enumerate(METHODS):
                noise = rng.normal(0, 6 + 12 * place, real.shape)
                rendered = (np.clip(real + noise, 0, 255) * inside).astype(np.uint8)
                difference = (np.abs(rendered.astype(int) - real) * inside).astype(np.uint8)
                own = [f"{stem}_{place}_{part}.png" for part in ("rendered", "difference")]
                for name, picture in zip(own, (rendered, difference), strict=True):
                    (root / name).write_bytes(encode_png(picture))
                entries.append(Pictures(case, image, method, f"{stem}_real.png", f"{stem}_segmented.png", *own))
    # an earlier version wrote three files for each chart
    charts = "similarity.svg", "similarity.png", "similarity-dark.png"
    found = Evaluation(**{**vars(found), "pictures": tuple(entries), "charts": charts})
    (root / EVALUATION).write_bytes(evaluation_bytes(found))
    (root / "similarity.png").write_bytes(encode_png(_wave(4, rng)))
    (root / "figure.png").write_bytes(encode_png(_wave(5, rng)))
    return root


def _wave(number: int, rng: np.random.Generator) -> np.ndarray:
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    waves = [np.sin(u / (7 + number) + part) * np.cos(v / (9 + part)) for part in range(3)]
    return np.clip(140 + 70 * np.stack(waves, -1) + rng.normal(0, 5, (HEIGHT, WIDTH, 3)), 0, 255).astype(np.uint8)


def _disc() -> np.ndarray:
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    return (np.hypot(u - WIDTH / 2, v - HEIGHT / 2) < 52)[..., None].astype(np.uint8)


def _scores(place: int, rng: np.random.Generator) -> dict[str, float]:
    ssim = 0.9 - 0.12 * place + rng.normal(0, 0.02)
    given = {"ssim_whole": ssim + 0.04, "ssim_surface": ssim - 0.1, "ssim_observed": ssim}
    return dict.fromkeys(SCORES, 0.5 + 0.1 * place) | given | {"sharpness": math.nan if place else 0.97}
