"""What the workers have in their own folders from an earlier run, asked before anything is rendered."""

import time
from collections.abc import Iterator
from dataclasses import replace

from distributed import CancelledError, Client
from distributed.scheduler import KilledWorker

from .. import __version__
from .call import ANSWER
from .orders import Order, Outcome
from .render_task import RenderJob

ASK_SECONDS = 120.0
"""A worker that has not answered after this time is not waited for: what it has is found, or rendered again."""


def held_views(client: Client, run: str, job: RenderJob) -> Iterator[Outcome]:
    """One outcome for each worker that is there and has views, with these as found ones."""
    workers = [*client.nthreads()]
    asked = Order(0, run, "held", __version__, job.to_json(), (0,), 0.0)
    orders = [replace(asked, number=-1 - place) for place in range(len(workers))]
    futures = [
        client.submit(
            ANSWER.function,
            *ANSWER.arguments(order.to_text()),
            key=f"held-{run}-{-order.number}",
            workers=[worker],
            pure=False,
        )
        for worker, order in zip(workers, orders, strict=True)
    ]
    if not futures:
        return
    give_up = time.monotonic() + ASK_SECONDS
    for future in futures:
        try:
            outcome = Outcome.from_text(future.result(timeout=max(0.0, give_up - time.monotonic())))
        except (OSError, RuntimeError, CancelledError, KilledWorker):
            # whatever it is, the worker's first order meets it too, and then it is reported
            continue
        if outcome.found:
            yield outcome
    client.cancel(futures, force=True)
