"""The same spoilt photographs by a network, refined from there, registered without training, and by both together."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from oneframe.images.pixel_values import to_uint8
from oneframe.learning.pose_network import PoseNetwork
from oneframe.registration.known_views import KnownViews
from oneframe.registration.verdict import ACCEPTED, REFUSED

from ..alignment.registration_trials import NO_ERROR, Registration, RegistrationTrial, Scene, spread
from ..sweeps.degradations import CLEAN, DEGRADATIONS
from .pose_trials import refined

NETWORK, REFINED = "network alone", "then refined by render and flow"
REGISTERED, LOCATED = "registered without training", "located: both together"
MOST_PHOTOGRAPHS = 6


def bad_photographs(
    scene: Scene,
    known: KnownViews,
    network: PoseNetwork,
    seed: int,
    *,
    quick: bool,
) -> Iterator[RegistrationTrial]:
    """Four trials for each photograph and degradation; ``part`` is the method.

    A pose of the network alone, or refined, has no verdict: each counts as accepted.
    """
    registration, location = Registration(scene, REGISTERED), Registration(scene, LOCATED, network.poses)
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
            pose = network.pose(to_uint8(image), frame.camera)
            yield registered
            yield location.trial(frame, kind, amount, image=image)
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
