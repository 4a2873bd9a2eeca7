"""Efficiency against the number of workers, from the model: for the engine's policy, and for what others do."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .cluster_model import Cluster, Interruptions, Policy, run_model

ALIKE = "chunks, workers all alike"
START_SECONDS = 10.0
FAILURE = Interruptions(mean_seconds=24 * 3600.0, away_seconds=60.0, notice_seconds=30.0)
PREEMPTION = Interruptions(mean_seconds=6 * 3600.0, away_seconds=600.0, notice_seconds=30.0)
WORKERS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000)
SECONDS_PER_VIEW = (1.0, 10.0)


@dataclass(frozen=True)
class OrderCost:
    """Measured time of scheduler and client for an order, s, at some numbers of workers, in rising order."""

    workers: tuple[int, ...]
    seconds: tuple[float, ...]

    def at(self, workers: int) -> float:
        """The time at any number of workers, s: interpolated over its logarithm.

        Beyond the largest measured number it grows as between the last two, but never falls.
        """
        most = self.workers[-1]
        if workers <= most or len(self.workers) < 2:
            return float(np.interp(np.log(workers), np.log(self.workers), self.seconds))
        slope = (self.seconds[-1] - self.seconds[-2]) / (most - self.workers[-2])
        return self.seconds[-1] + max(0.0, slope) * (workers - most)


@dataclass(frozen=True)
class ModelPoint:
    """Mean of some runs of the model.

    Attributes
    ----------
    series
        A value of :class:`.Policy`, or :data:`ALIKE`.
    seconds_per_view, workers, target_seconds
        What was modelled.
    efficiency, seconds, server_load
        As in :class:`.ModelledRun`.
    """

    series: str
    seconds_per_view: float
    workers: int
    target_seconds: float
    efficiency: float
    seconds: float
    server_load: float


def real_cluster(workers: int, cost: OrderCost, *, target_seconds: float) -> Cluster:
    """Workers as on a shared cluster: 5 % are ten times slower, some fail or are preempted."""
    return Cluster(
        workers,
        start_seconds=START_SECONDS,
        order_seconds=cost.at(workers),
        spread=0.2,
        slow_share=0.05,
        slow_factor=10.0,
        view_spread=0.3,
        interruptions=(FAILURE, PREEMPTION),
        target_seconds=target_seconds,
    )


def alike_cluster(workers: int, cost: OrderCost, *, target_seconds: float) -> Cluster:
    """Workers of one speed that never stop; their start and the orders cost the same."""
    return Cluster(
        workers,
        start_seconds=START_SECONDS,
        order_seconds=cost.at(workers),
        target_seconds=target_seconds,
    )


def sweep(
    views: int,
    cost: OrderCost,
    *,
    seed: int,
    workers: Sequence[int] = WORKERS,
    seconds_per_view: Sequence[float] = SECONDS_PER_VIEW,
    targets: Sequence[float] = (15.0,),
    runs: int = 3,
) -> Iterator[ModelPoint]:
    """Model all series at every number of workers; the targets are for the engine's policy alone."""
    series = [(policy.value, policy, real_cluster) for policy in Policy] + [(ALIKE, Policy.CHUNKS, alike_cluster)]
    for seconds in seconds_per_view:
        for name, policy, cluster in series:
            for target in targets if policy is Policy.CHUNKS else targets[:1]:
                for number in workers:
                    found = [
                        run_model(
                            cluster(number, cost, target_seconds=target),
                            policy,
                            views,
                            seconds,
                            np.random.default_rng((seed, run)),
                        )
                        for run in range(runs)
                    ]
                    yield ModelPoint(
                        name,
                        seconds,
                        number,
                        target,
                        float(np.mean([run.efficiency for run in found])),
                        float(np.mean([run.seconds for run in found])),
                        float(np.mean([run.server_load for run in found])),
                    )
