"""The same spoilt photographs by a network, refined from there by render and flow, and registered without training."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from oneframe.registration.known_views import KnownViews
from oneframe.registration.verdict import ACCEPTED, REFUSED

from ..alignment.registration_trials import NO_ERROR, Registration, RegistrationTrial, Scene, spread
from ..sweeps.degradations import CLEAN, DEGRADATIONS
from .pose_trials import refined

NETWORK, REFINED, REGISTERED = "network alone", "then refined by render and flow", "registered without training"
MOST_PHOTOGRAPHS = 6


def bad_photographs(
    scene: Scene,
    known: KnownViews,
    pose_by: Callable[[np.ndarray], np.ndarray | None],
    seed: int,
    *,
    quick: bool,
) -> Iterator[RegistrationTrial]:
    """Three trials for each photograph and degradation; ``part`` is the method.

    ``pose_by`` gives the network's pose, if it finds one, of an image ``(H, W, 3)`` float32. It has no verdict: every
    pose counts as accepted.
    """
    registration = Registration(scene, REGISTERED)
    for place in spread(len(scene.photographs), MOST_PHOTOGRAPHS):
        frame = scene.photographs[place]
        spoilt = [(CLEAN, 0.0, frame.image)]
        for number, (kind, how) in enumerate(list(DEGRADATIONS.items())[: 1 if quick else None]):
            for amount in how.amounts[-1:] if quick else how.amounts:
                if amount != how.clean:
                    rng = np.random.default_rng([seed, place, number])
                    spoilt.append((kind, amount, how.spoil(frame.image, amount, rng)))
        for kind, amount, image in spoilt:
            registered = registration.trial(frame, kind, amount, image=image)
            pose = pose_by(image)
            yield registered
            for method, found in (
                (NETWORK, pose),
                (REFINED, refined(known, replace(frame, image=image), pose)),
            ):
                errors = NO_ERROR if found is None else registration.errors(found, frame.cam_from_model)
                error_deg, error_percent, error_px = errors
                yield replace(
                    registered,
                    part=method,
                    state=REFUSED if found is None else ACCEPTED,
                    probability=float("nan"),
                    seconds=float("nan"),
                    error_deg=error_deg,
                    error_percent=error_percent,
                    error_px=error_px,
                )
