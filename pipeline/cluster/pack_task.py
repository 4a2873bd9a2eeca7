"""On a worker: shards of a pack, packed by the worker's own process."""

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ..dataset.layout import RECORD
from ..errors import InputError, RunError
from ..packing.disk import PackWriteError
from ..packing.manifest import shard_to_json
from ..packing.pack_folder import Plan, keep_shard, kept_shard, read_plan
from ..packing.shard import PackedShard, ShardOrder, pack_shard
from ..packing.source import read_description
from .orders import Order, Outcome
from .render_task import Surroundings
from .visible_folder import check_visible

_INSTEAD = "choose one that all machines see (--out), or pack without --cluster"


@dataclass(frozen=True)
class PackJob:
    """What the pack orders of a run have in common; items are numbers of shards.

    Attributes
    ----------
    root, out
        The folders of the dataset and of the pack.
    identity
        Of the dataset.
    client
        Name of the machine that the run was started on.
    look_seconds
        How long to wait for a folder to show what another machine has just written into it.
    """

    root: str
    out: str
    identity: str
    client: str
    look_seconds: float = 10.0

    def to_json(self) -> dict[str, Any]:
        """The JSON object."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "PackJob":
        """Read what :meth:`to_json` gives."""
        return cls(**content)


def perform(order: Order, worker: Surroundings) -> Outcome:
    """Pack the shards of an order, within its budget; what is there already is only found."""
    job, begin = PackJob.from_json(order.job), time.monotonic()
    outcome = Outcome(order.number, worker.address, worker.host)
    finished: list[PackedShard] = []
    found: list[PackedShard] = []
    left = [*order.items]

    def on_view() -> None:
        worker.beat("packing", len(finished) + len(found))

    try:
        plan, k = _plan(order.run, job)
        parts = plan.shard_views()
        while left and not worker.is_closing() and time.monotonic() - begin < order.budget_seconds:
            number, out = left[0], Path(job.out)
            shard = kept_shard(out, number, parts[number])
            if shard is None:
                shard = pack_shard(
                    ShardOrder(Path(job.root), out, number, parts[number], plan.identity, k, plan.jpeg_quality), on_view
                )
                keep_shard(out, shard)
                finished.append(shard)
            else:
                found.append(shard)
            left.pop(0)
    except (PackWriteError, _UnusableError, OSError, InputError) as error:
        outcome = replace(outcome, refused=str(error))
    except RunError as error:
        # a view is damaged, which every worker would find
        outcome = replace(outcome, wrong_input=str(error))
    return replace(
        outcome,
        finished=tuple(shard.number for shard in finished),
        found=tuple(shard.number for shard in found),
        left=tuple(left),
        seconds=time.monotonic() - begin if finished else 0.0,
        results=tuple((shard.number, shard_to_json(shard)) for shard in (*finished, *found)),
    )


class _UnusableError(RunError):
    """Why this worker can pack nothing."""


def _plan(run: str, job: PackJob) -> tuple[Plan, tuple[float, ...]]:
    try:
        check_visible(run, job.out, job.client, job.look_seconds, _INSTEAD)
    except RunError as error:
        raise _UnusableError(str(error)) from None
    plan, description = read_plan(Path(job.out)), read_description(Path(job.root) / RECORD)
    if not plan.identity == description.identity == job.identity:
        raise _UnusableError(
            f"{job.root}: expected the dataset that {job.client} packs, found another one; mount the shared folder "
            "there at the same path"
        )
    if plan.jpeg_quality is not None:
        # only now: without JPEG, packing needs no OpenCV
        try:
            from ..packing.jpeg import VERSION
        except ImportError as error:
            raise _UnusableError(f"it has no OpenCV ({error}), which --jpeg needs; install it there") from None
        if plan.opencv != VERSION:
            raise _UnusableError(
                f"it has OpenCV {VERSION}, and the pack's JPEG files are those of OpenCV {plan.opencv}; install that "
                "version there"
            )
    return plan, tuple(float(value) for value in description.camera.k.ravel())
