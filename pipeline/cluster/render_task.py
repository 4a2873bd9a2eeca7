"""On a worker: an order of views, rendered by a process that lives on for the next one."""

import os
import site
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from ..blender.command_line import EXIT_INPUT, EXIT_RUN, blender_command
from ..blender.dataset.render_process import AHEAD, RenderProcess
from ..dataset.layout import occupied_views
from ..dataset.survey import is_finished, survey_views
from ..errors import RunError
from . import render_processes, worker_places
from .orders import Order, Outcome
from .visible_folder import check_visible
from .worker_places import Machine, SentCase

_ROOT = Path(__file__).resolve().parents[2]
_SCRIPT = _ROOT / "scripts" / "render_dataset.py"
_MOST_FAILED_STARTS = 3

_failed_starts: dict[str, list[str]] = {}


@dataclass(frozen=True)
class Limits:
    """Times in s.

    Attributes
    ----------
    look
        To wait for the dataset's folder to show what another machine has just written into it.
    start
        Longest time until a process has finished its first view.
    view, view_factor
        Longest time for each further view: the larger one of ``view``, and ``view_factor`` times the mean.
    """

    look: float = 10.0
    start: float = 1800.0
    view: float = 60.0
    view_factor: float = 20.0


@dataclass(frozen=True)
class RenderJob:
    """What the render orders of a run have in common.

    Attributes
    ----------
    case, out
        The case file and the dataset's folder, as the workers see them; an empty ``out`` is a temporary folder.
    arguments
        The options of the run, as a command line.
    identity, kinds
        The dataset's identity, and the kinds of files of a view.
    threads
        Render threads of a process.
    client
        Name of the machine that the run was started on.
    command
        Starts the render command; empty for the worker's own Python.
    blender
        A Blender program that renders, instead.
    limits
        When a process is given up.
    description
        Content of ``dataset.json`` for workers with folders of their own; ``None`` if they share that of the run.
    sent
        The case that is sent to workers, which replaces ``case``.
    """

    case: str
    out: str
    arguments: tuple[str, ...]
    identity: str
    kinds: tuple[str, ...]
    threads: int
    client: str
    command: tuple[str, ...] = ()
    blender: str | None = None
    limits: Limits = field(default_factory=Limits)
    description: Mapping[str, Any] | None = None
    sent: SentCase | None = None

    def to_json(self) -> dict[str, Any]:
        """The JSON object."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "RenderJob":
        """Read what :meth:`to_json` gives."""
        lists = {name: tuple(content[name]) for name in ("arguments", "kinds", "command")}
        sent = None if content["sent"] is None else SentCase(**content["sent"])
        return cls(**{**content, **lists, "limits": Limits(**content["limits"]), "sent": sent})


class Surroundings(Machine, Protocol):
    """The worker, as a task sees it."""

    address: str
    host: str

    def is_closing(self) -> bool:
        """Whether the worker is about to end."""


def perform(order: Order, worker: Surroundings) -> Outcome:
    """Render the views of an order; what is on disk already is only found.

    Returns
    -------
    Within the order's budget, or when its views in work are finished after that. It never raises what a user can
    cause.
    """
    job = RenderJob.from_json(order.job)
    outcome = Outcome(order.number, worker.address, worker.host)
    try:
        job = _on_this_worker(order.run, job, worker)
    except RunError as error:
        return replace(outcome, refused=str(error))
    views: list[int] = []
    found: list[int] = []
    for view in order.items:
        is_there = view not in order.anew and is_finished(Path(job.out), view, job.identity, job.kinds)
        (found if is_there else views).append(view)
    outcome = replace(outcome, found=tuple(found))
    if not views:
        return outcome
    process = render_processes.take(order.run, job.out)
    if process is None:
        worker.beat("starting", len(found))
        try:
            process = RenderProcess(_command(job), environment=_environment(job))
        except OSError as error:
            return replace(outcome, refused=f"it cannot start {_command(job)[0]} ({error.strerror})")
        render_processes.started(order.run, process)
    try:
        return _render(order, views, process, job.limits, worker, outcome)
    finally:
        render_processes.give_back(order.run, process)


def _render(
    order: Order, views: list[int], process: RenderProcess, limits: Limits, worker: Surroundings, outcome: Outcome
) -> Outcome:
    waiting = deque(views)
    finished: list[int] = []
    ahead = 1 if order.alone else AHEAD
    begin = last = time.monotonic()
    hung = ""

    def has_time() -> bool:
        return process.ready_since is None or time.monotonic() - max(begin, process.ready_since) < order.budget_seconds

    while True:
        while waiting and len(process.assigned) < ahead and has_time() and not worker.is_closing():
            process.assign(waiting.popleft())
        if not process.assigned or process.has_ended:
            break
        index = process.wait_for_view(0.5)
        now = time.monotonic()
        if index is not None:
            finished.append(index)
            last = now
            process.seconds_per_view = (last - max(begin, process.ready_since or begin)) / len(finished)
        worker.beat("starting" if process.ready_since is None else "rendering", len(outcome.found) + len(finished))
        pace = process.seconds_per_view
        limit = limits.start if pace is None else max(limits.view, limits.view_factor * pace)
        if now - last > limit and not hung:
            hung = f"finished no view for {limit:.0f} s and was ended"
            process.kill()
    outcome = replace(
        outcome,
        finished=tuple(finished),
        left=tuple(waiting),
        seconds=last - max(begin, process.ready_since or begin) if finished else 0.0,
    )
    if not process.has_ended:
        return outcome
    return _after_end(order.run, process, outcome, hung)


def _after_end(run: str, process: RenderProcess, outcome: Outcome, hung: str) -> Outcome:
    ending, unfinished = process.ending(), tuple(process.assigned)
    was_ready = process.ready_since is not None
    if was_ready and ending.code == EXIT_INPUT:
        return replace(outcome, wrong_input=ending.last)
    back = replace(outcome, left=(*unfinished, *outcome.left))
    if ending.code in (EXIT_INPUT, EXIT_RUN):
        return replace(back, refused=ending.last)
    how = hung or ending.how + (f" ({ending.last})" if ending.last else "")
    if was_ready:
        return replace(
            outcome, left=(*unfinished[1:], *outcome.left), crashed=unfinished[:1], lost=(f"a render process {how}",)
        )
    failed = _failed_starts.setdefault(run, [])
    failed.append(how)
    if len(failed) >= _MOST_FAILED_STARTS:
        return replace(back, refused=f"its render processes end before they render: the last one {how}")
    return replace(back, lost=(f"a render process {how} before it rendered",))


def held(order: Order, worker: Surroundings) -> Outcome:
    """The finished views in the worker's own folder, as found ones; the order's items do not matter."""
    job = RenderJob.from_json(order.job)
    outcome = Outcome(order.number, worker.address, worker.host)
    try:
        folder = _folder(order.run, job, worker)
        views = range(occupied_views(folder))
        survey = survey_views(folder, views, job.description or {}, job.kinds)
    except RunError as error:
        return replace(outcome, refused=str(error))
    return replace(outcome, found=tuple(sorted(survey.finished)))


def end_run(run: str) -> None:
    """End the processes of a run, and unlock its folder."""
    render_processes.end_run(run)
    worker_places.end_run(run)


def _on_this_worker(run: str, job: RenderJob, worker: Surroundings) -> RenderJob:
    """The job with this worker's paths.

    Raises
    ------
    RunError
        Why this worker can do nothing of it.
    """
    _check_program(job)
    job = replace(job, out=str(_folder(run, job, worker)))
    if job.sent is not None:
        case, arguments = worker_places.sent_case(run, job.sent, worker)
        job = replace(job, case=case, arguments=(*job.arguments, *arguments))
    return job


def _folder(run: str, job: RenderJob, worker: Surroundings) -> Path:
    if job.description is not None:
        return worker_places.own_folder(run, job.out, job.identity, job.description, worker)
    instead = (
        "choose one that all machines see (--out), or let workers write to folders of their own (--gather, or "
        "--out-on-workers)"
    )
    check_visible(run, job.out, job.client, job.limits.look, instead)
    return Path(job.out)


def _check_program(job: RenderJob) -> None:
    if job.blender is not None and not _SCRIPT.is_file():
        raise RunError(
            f"it has no {_SCRIPT}, which a Blender program needs; install OneFrame there from a checkout "
            "(pip install --editable), or leave out --blender-on-workers"
        )


def _command(job: RenderJob) -> list[str]:
    if job.blender is not None:
        start: tuple[str, ...] = tuple(blender_command(job.blender, str(_SCRIPT)))
    else:
        start = job.command or (sys.executable, "-m", "pipeline.commands", "render")
    return [*start, job.case, "--out", job.out, *job.arguments, "--worker", f"--threads={job.threads}"]


def _environment(job: RenderJob) -> dict[str, str]:
    """So that the process finds the same OneFrame as the worker, which may have it from its current folder."""
    installed: Callable[[], list[str]] = getattr(site, "getsitepackages", list)
    if str(_ROOT) in (*installed(), site.getusersitepackages()):
        return {}
    return {"PYTHONPATH": os.pathsep.join(filter(None, [str(_ROOT), os.environ.get("PYTHONPATH", "")]))}
