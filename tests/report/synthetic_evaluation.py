"""The folder of a small evaluation, by its contract, with pictures of waves instead of photographs."""

import json
from pathlib import Path

import numpy as np

from oneframe.evaluation.scores.view_scores import SCORES as ALL_SCORES
from oneframe.images.png import encode_png

METHODS = (("ours, projective, cycles", False), ("ours, vertex, eevee", False), ("paper (PyVista)", True))
CASES = {"relief": ("frame_03.png", "frame_05.png", "frame_09.png"), "bone": ("view_1.png", "view_2.png")}
SCORES = (
    "ssim_whole",
    "ssim_surface",
    "ssim_observed",
    "psnr_observed",
    "error_observed",
    "flow_px",
    "sharpness",
    "error_observed_corrected",
)
WIDTH, HEIGHT = 160, 120


def write_evaluation(root: Path, rng: np.random.Generator) -> Path:
    """Write all of its files."""
    pictures = root / "pictures"
    pictures.mkdir(parents=True)
    rows, entries = [], []
    for case, images in CASES.items():
        for number, image in enumerate(images):
            stem = f"{case}_{Path(image).stem}"
            real = _wave(number, rng)
            inside = _disc()
            names = {"real": f"pictures/{stem}_real.png", "segmented": f"pictures/{stem}_segmented.png"}
            (root / names["real"]).write_bytes(encode_png(real))
            (root / names["segmented"]).write_bytes(encode_png(real * inside))
            for place, (method, _) in enumerate(METHODS):
                noise = rng.normal(0, 6 + 12 * place, real.shape)
                rendered = (np.clip(real + noise, 0, 255) * inside).astype(np.uint8)
                difference = (np.abs(rendered.astype(int) - real) * inside).astype(np.uint8)
                own = {part: f"pictures/{stem}_{place}_{part}.png" for part in ("rendered", "difference")}
                (root / own["rendered"]).write_bytes(encode_png(rendered))
                (root / own["difference"]).write_bytes(encode_png(difference))
                entries.append({"case": case, "image": image, "method": method, **names, **own})
                rows.append({"case": case, "image": image, "method": method, **_scores(place, rng)})
    summary = [
        _interval(case, method, score, rows) for case in ("all", *CASES) for method, _ in METHODS for score in SCORES
    ]
    content = {
        "format": "oneframe evaluation 1",
        "conditions": {
            "machine": "2 cores", "versions": {"OneFrame": "0.1"}, "configuration": {"seed": 0},
            "measured": "2026-01-01",
        },
        "cases": [{"name": name, "case": f"{name}/case.toml", "frames": images} for name, images in CASES.items()],
        "methods": [{"name": name, "peer": peer} for name, peer in METHODS],
        "rows": rows,
        "summary": summary,
        "distribution": [
            {"case": "all", "method": name, "fid": 40.0 + 30 * place, "fid_biased": True, "kid": 0.02 * (place + 1),
             "kid_standard_error": 0.003, "n": 5}
            for place, (name, _) in enumerate(METHODS)
        ],
        "bound": [{"case": "all", "score": "ssim_observed", "mean": 0.93, "low": 0.9, "high": 0.95, "jitter_px": 0.5}],
        "pictures": entries,
        "charts": ["similarity.svg", "similarity.png", "similarity-dark.png"],
    }  # fmt: skip
    (root / "evaluation.json").write_text(json.dumps(content))
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


def _scores(place: int, rng: np.random.Generator) -> dict[str, float | None]:
    ssim = 0.9 - 0.12 * place + rng.normal(0, 0.02)
    return dict.fromkeys(ALL_SCORES) | {
        "ssim_whole": ssim + 0.04, "ssim_surface": ssim - 0.1, "ssim_observed": ssim, "psnr_observed": 24 - 3.0 * place,
        "error_observed": 8 + 4.0 * place, "error_observed_corrected": 7 + 4.0 * place, "flow_px": 0.4 + 0.1 * place,
        "sharpness": None if place else 0.97,
    }  # fmt: skip


def _interval(case: str, method: str, score: str, rows: list[dict]) -> dict[str, object]:
    values = [
        row[score] for row in rows
        if row["method"] == method and case in ("all", row["case"]) and row[score] is not None
    ]  # fmt: skip
    if not values:
        return {"case": case, "method": method, "score": score, "mean": None, "low": None, "high": None, "n": 0}
    mean, half = float(np.mean(values)), 2 * float(np.std(values)) / np.sqrt(len(values))
    return {
        "case": case, "method": method, "score": score, "mean": mean, "low": mean - half, "high": mean + half,
        "n": len(values),
    }  # fmt: skip
