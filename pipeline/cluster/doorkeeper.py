"""What an order does first on a worker: it looks for OneFrame there, and refuses if it is missing or another version.

A worker, and a scheduler, may lack OneFrame or have another Python. So this file travels as text that ``eval`` runs,
with each order: see :mod:`pipeline.cluster.call`. It imports only the standard library and Dask.
"""

import importlib
import json
import platform
import sys


def answer(text: str) -> str:
    """Do an order, given as JSON; the outcome as JSON."""
    from distributed import get_worker

    order, worker = json.loads(text), get_worker()
    host = platform.node()

    def refused(why: str) -> str:
        return json.dumps({"number": order["number"], "worker": worker.address, "host": host, "refused": why})

    wanted = f'install OneFrame {order["oneframe"]} there, with its extra "cluster", and start the worker again'
    try:
        found = importlib.import_module("pipeline").__version__
        tasks = importlib.import_module("pipeline.cluster.tasks")
    except (ImportError, AttributeError) as error:
        return refused(f"its Python, {sys.executable}, has no OneFrame ({error}); {wanted}")
    if found != order["oneframe"]:
        return refused(f"it has OneFrame {found}, the run has {order['oneframe']}; {wanted}")
    return tasks.perform(text, worker, host)


def end(run: str) -> None:
    """End what a run still does on this worker; nothing if there is no OneFrame."""
    tasks = sys.modules.get("pipeline.cluster.tasks")
    if tasks is not None:
        tasks.end_run(run)
