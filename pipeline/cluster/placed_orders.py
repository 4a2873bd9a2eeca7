"""Orders that are with the scheduler: how they get there, and how their results come back or are cancelled."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from distributed import CancelledError, Client, Future

from .call import Call
from .orders import Order
from .sources import is_connected, losing_scheduler

RESULT_SECONDS = 30.0
"""Longest wait for a result that is there."""


@dataclass
class PlacedOrder:
    """An order and what is known of it.

    Attributes
    ----------
    order, future
        The order, and Dask's hold on its result.
    allowed
        Addresses of the workers that may do it; ``None`` for all.
    begun_on, heard
        The worker that has begun it, and when that gave the last sign of life.
    done
        Number of its items that are done.
    """

    order: Order
    future: Future
    allowed: frozenset[str] | None
    begun_on: str = ""
    heard: float = 0.0
    done: int = 0


class PlacedOrders:
    """The way to the scheduler and back; what happens while it is lost is never an error here."""

    def __init__(self, client: Client, call: Call) -> None:
        """Place orders with a client's scheduler, as calls of a function."""
        self._client, self._call = client, call

    def place(
        self, orders: Sequence[Order], allowed: frozenset[str] | None, on_end: Callable[[int], None]
    ) -> list[PlacedOrder]:
        """Hand orders over; none if the scheduler has just been lost.

        ``on_end`` gets the number of each order that has ended in any way, in another thread.
        """
        rows = [self._call.arguments(order.to_text()) for order in orders]
        futures: list[Future] = []
        with losing_scheduler(self._client):
            futures = self._client.map(
                self._call.function,
                *([*column] for column in zip(*rows, strict=True)),
                key=[f"{order.task}-{order.run}-{order.number}" for order in orders],
                workers=None if allowed is None else sorted(allowed),
                pure=False,
            )
        placed = [PlacedOrder(order, future, allowed) for order, future in zip(orders, futures, strict=False)]
        for one in placed:
            one.future.add_done_callback(lambda _future, number=one.order.number: on_end(number))
        return placed

    def results(self, placed: Sequence[PlacedOrder]) -> list[Any]:
        """The results of finished orders, or the exception where one cannot be had: its worker may just have gone."""
        if not placed:
            return []
        futures = [one.future for one in placed]
        try:
            return [*self._client.gather(futures)]
        except (Exception, CancelledError):
            return [_result(future) for future in futures]

    def cancel(self, placed: Sequence[PlacedOrder]) -> None:
        """Take orders back."""
        if placed and is_connected(self._client):
            with losing_scheduler(self._client):
                self._client.cancel([one.future for one in placed], force=True)

    def keys_at(self, workers: Iterable[str]) -> set[str]:
        """Keys of the orders that Dask has sent to workers, begun or not."""
        found: set[str] = set()
        if workers:
            # one of them may leave at this moment
            with losing_scheduler(self._client), suppress(KeyError):
                for keys in self._client.processing(workers=[*workers]).values():
                    found.update(keys)
        return found


def _result(future: Future) -> Any:
    try:
        return future.result(timeout=RESULT_SECONDS)
    except (Exception, CancelledError) as error:
        return error
