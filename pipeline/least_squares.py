"""Nonlinear least squares by damped steps (Levenberg 1944, Marquardt 1963)."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

State = TypeVar("State")

START_DAMPING, MOST_TRIES = 1e-3, 4
"""Of the first step, relative to the curvature of each parameter; and steps tried from one place."""
FLOOR = 1e-12
"""Without it, a parameter that changes no residual would make the system singular."""


def damped_least_squares(
    start: State,
    linear: Callable[[State], tuple[np.ndarray, np.ndarray]],
    better: Callable[[State, np.ndarray], State | None],
    is_settled: Callable[[State, State], bool],
    *,
    steps: int,
) -> State:
    """The state at a local minimum of a sum of squares.

    Parameters
    ----------
    start
        The parameters, with whatever else the caller knows of them.
    linear
        ``(D, D)`` J^T J and ``(D,)`` J^T r at a state, of the derivatives of what is predicted and of the residuals.
    better
        The state after a step ``(D,)``; ``None`` if its cost is no less.
    is_settled
        Whether the step from one state to the next was the last that is needed.
    steps
        The most that are taken.
    """
    damping, state = START_DAMPING, start
    for _ in range(steps):
        normal, gradient = linear(state)
        for _ in range(MOST_TRIES):
            damped = normal + np.diag(damping * np.diag(normal) + FLOOR)
            after = better(state, np.linalg.solve(damped, gradient))
            if after is not None:
                break
            damping *= 10
        else:
            return state
        before, state, damping = state, after, 0.2 * damping
        if is_settled(before, state):
            break
    return state
