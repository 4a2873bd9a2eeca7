"""Views rendered by the workers of a cluster, whose processes live on between orders: a scene is built once.

A worker with k threads does k orders at a time, so it has up to k processes of a run. They end with run or worker, and
when they have waited for an order for :data:`IDLE_SECONDS`, as when the run has been killed.
"""

import os
import secrets
import shutil
import sys
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from distributed import Client, Worker

from ..case.case_file import read_case
from ..dataset.identity import description_bytes
from ..dataset.layout import RECORD, ViewPaths
from ..dataset.option_arguments import option_arguments
from ..dataset.options import PATHS
from ..dataset.run.elsewhere import CASE, MissingViews, case_parcel, gather_view
from ..dataset.run.render_processes import AHEAD, RenderProcess
from ..dataset.run.survey import is_finished
from ..errors import RunError
from ..process.command_line import blender_command
from ..progress import Progress
from .on_worker import LostError, OnWorker
from .orders import Orders

IDLE_SECONDS = 120.0
VIEW_SECONDS = 1800.0
"""A process hangs that builds its scene for so long, or finishes no view."""
GATHERED_BYTES = 64_000_000
"""About the largest result of an order."""
CASE_FOLDER = "<case>"
"""Stands in arguments for the folder of the files that were sent."""
_PACKAGE = Path(__file__).resolve().parents[1]
_SCRIPTS = _PACKAGE.parent / "scripts"
_FOUND_IN = _PACKAGE.parent if _PACKAGE.name == "oneframe" else _SCRIPTS
"""Where the package is found by its name: in a checkout by ``scripts/oneframe.py``."""
_RENDER: tuple[str, ...] = (sys.executable, "-m", "oneframe.commands", "render")


@dataclass
class RenderOnWorker(OnWorker):
    """The render processes of a run on one worker.

    Attributes
    ----------
    arguments
        Of the render command: case and options.
    blender
        A Blender program that renders, instead of the worker's own Python.
    identity, kinds
        The dataset's identity, and the kinds of files of a view.
    damaged
        Views that are rendered whatever is on disk.
    description
        Content of ``dataset.json`` if the views are gathered; ``None`` if workers share the folder of the run.
    """

    arguments: tuple[str, ...]
    blender: str | None
    identity: str
    kinds: tuple[str, ...]
    damaged: frozenset[int]
    description: Mapping[str, object] | None

    def open(self, own_folder: Path, case: Mapping[str, bytes] | None) -> None:
        """Check folder and program, and start the first process."""
        self._processes: list[RenderProcess] = []
        self._free: list[RenderProcess] = []
        self._lock, self._idle, self._is_closed = threading.RLock(), threading.Timer(0, print), False
        self._own, self._out = own_folder, Path(self.folder)
        self.check("choose one that all machines see (--out), or let the views be fetched (--gather)")
        start = _RENDER
        if self.blender is not None:
            start = (*blender_command(self.blender, str(_SCRIPTS / "render_dataset.py")),)
        sent = {f"case/{name}": content for name, content in (case or {}).items()}
        if self.description is not None:
            self._out = own_folder / "dataset"
            sent[f"dataset/{RECORD}"] = description_bytes(self.description)
        for name, content in sent.items():
            (own_folder / name).parent.mkdir(parents=True, exist_ok=True)
            (own_folder / name).write_bytes(content)
        arguments = [text.replace(CASE_FOLDER, str(own_folder / "case")) for text in self.arguments]
        self._start = [*start, *arguments, f"--out={self._out}", "--worker"]
        self._give_back(self._started())

    def do(self, items: Sequence[int]) -> dict[int, Any]:
        """Render views; those that are gathered come with their files."""
        is_there = {v for v in items if v not in self.damaged and is_finished(self._out, v, self.identity, self.kinds)}
        waiting, done = deque(view for view in items if view not in is_there), {v: self._gathered(v) for v in is_there}
        process = self._process() if waiting else None
        while process is not None:
            size = sum(len(content) for files in done.values() for content in files.values())
            while waiting and len(process.assigned) < AHEAD and size < GATHERED_BYTES:
                process.assign(waiting.popleft())
            if not process.assigned:
                self._give_back(process)
                break
            view = process.wait_for_view(VIEW_SECONDS)
            if view is None:
                raise self._failure(process, f"view {process.assigned[0]}: ")
            done[view] = self._gathered(view)
        return done

    def teardown(self, worker: Worker) -> None:
        """End the processes, at once."""
        self._is_closed = True
        self._kill(self._processes)
        shutil.rmtree(self._own, ignore_errors=True)

    def _gathered(self, view: int) -> dict[str, bytes]:
        """The files of a view by their names in a dataset; they leave this machine. None if the folder is shared."""
        paths, files = ViewPaths(self._out, view), {}
        # the record first: without it, what is left is no view
        for kind in ("frame", *self.kinds) if self.description is not None else ():
            files[paths.relative(kind)] = paths.file(kind).read_bytes()
            paths.file(kind).unlink()
        return files

    def _process(self) -> RenderProcess:
        with self._lock:
            while self._free:
                if (process := self._free.pop()).is_alive():
                    return process
        return self._started()

    def _started(self) -> RenderProcess:
        # the same OneFrame as the worker, which may be that of a checkout
        scripts = [str(_FOUND_IN)] if (_FOUND_IN / "oneframe.py").is_file() else []
        paths = os.pathsep.join(filter(None, [*scripts, os.environ.get("PYTHONPATH", "")]))
        try:
            process = RenderProcess(self._start, environment={"PYTHONPATH": paths})
        except OSError as error:
            raise RunError(f"it cannot start {self._start[0]} ({error.strerror})") from None
        with self._lock:
            self._processes = [process, *(one for one in self._processes if one.is_alive())]
            if self._is_closed:
                process.kill()
        if not process.wait_until_ready(VIEW_SECONDS):
            raise self._failure(process, "before it rendered, ")
        return process

    def _failure(self, process: RenderProcess, where: str) -> Exception:
        """What follows from the end of a process, which ends if it hangs."""
        if hangs := not process.has_ended:
            process.kill()
        ending = process.ending()
        if ending.error is None or hangs:
            how = f"finished no view for {VIEW_SECONDS:.0f} s and was ended" if hangs else ending.how
            return LostError(f"{where}a render process {how} ({ending.last or 'without a word'})")
        # before its first view, it is this worker that has other input than the run
        return ending.error if process.is_ready else RunError(str(ending.error))

    def _give_back(self, process: RenderProcess) -> None:
        with self._lock:
            self._free.append(process)
            self._idle.cancel()
            self._idle = threading.Timer(IDLE_SECONDS, self._kill, (self._free,))
            self._idle.daemon = True
            self._idle.start()

    def _kill(self, processes: list[RenderProcess]) -> None:
        with self._lock:
            for process in processes:
                process.kill()


@dataclass(frozen=True)
class RenderPool:
    """Renders views on the workers of a scheduler: an :data:`.Elsewhere` of a run.

    Attributes
    ----------
    client
        Connected to the scheduler of the workers.
    send_case, gather
        Whether workers get the case, and whether they render into folders of their own, from which the views come here.
    blender
        A Blender program on the workers' machines that renders there.
    """

    client: Client
    send_case: bool = False
    gather: bool = False
    blender: str | None = None

    def __call__(self, missing: MissingViews, progress: Progress) -> None:
        """Render: see :data:`.Elsewhere`."""
        out, case, options = os.path.abspath(missing.out), os.path.abspath(missing.case), missing.options
        files = None
        if self.send_case:
            parcel = case_parcel(read_case(missing.case), options)
            files, case = parcel.files, f"{CASE_FOLDER}/{CASE}"
            options = replace(
                options,
                poses=None if parcel.poses is None else f"{CASE_FOLDER}/{parcel.poses}",
                occluder_meshes=None if parcel.instruments is None else f"{CASE_FOLDER}/{parcel.instruments}",
            )
        else:
            named = {name: getattr(options, name) for name in PATHS}
            options = replace(options, **{name: os.path.abspath(path) for name, path in named.items() if path})
        plugin = RenderOnWorker(
            run=secrets.token_hex(8),
            folder="" if self.gather else out,
            arguments=(case, *option_arguments(options), "--threads=1"),
            blender=self.blender,
            identity=missing.identity,
            kinds=missing.kinds,
            damaged=missing.damaged,
            description=missing.description if self.gather else None,
        )
        orders = Orders(self.client, plugin, missing.views, progress, files)
        rendered = 0
        with closing(orders.outcomes()) as outcomes:
            for count, done in enumerate(outcomes, 1):
                for view, files in done.items() if self.gather else ():
                    gather_view(ViewPaths(Path(out), view), missing.identity, missing.kinds, files)
                rendered += len(done)
                progress.update(missing.finished + rendered, f"{orders.state()}; {count} orders")
        progress.note(f"{rendered} views rendered by {orders.state()}")
