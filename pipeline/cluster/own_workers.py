"""A scheduler with workers of its own on this machine, run by a child process.

Child and workers end when its standard input ends, also if its parent is killed. Whoever connects to a scheduler or
worker of Dask can run code there: so the child makes a certificate that only its parent and its workers get. The child
is a plain Python also where a Blender program renders, whose start-up code does not bear Python's ``multiprocessing``.
"""

import json
import logging
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import dask
import distributed
from distributed.security import Security

from ..errors import RunError

CLOSE_SECONDS = 20.0
NO_DASHBOARD = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
"""Options of a scheduler: Dask cannot do without an HTTP server, so this one is for its machine and has no pages."""
CONFIGURATION = {
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    # a stopped worker is given up soon
    "distributed.scheduler.worker-ttl": "30s",
    "distributed.scheduler.allowed-failures": 10,
    # a busy machine is no reason for a warning
    "distributed.admin.tick.limit": "60s",
}
"""Dask's settings in the child."""
_CLIENT = ("tls_ca_file", "tls_client_cert", "tls_client_key")
_PACKAGE = Path(__file__).resolve().parents[1]
FOUND_IN = _PACKAGE.parent if _PACKAGE.name == "oneframe" else _PACKAGE.parent / "scripts"
"""Where the package is found by its name: in a checkout by ``scripts/oneframe.py``."""


@contextmanager
def own_workers(count: int) -> Iterator[tuple[str, Security]]:
    """Start workers of one thread, which end with the context.

    Yields
    ------
    Address of the scheduler, and what it admits a client by.

    Raises
    ------
    RunError
        They cannot be started.
    """
    # Dask is there where this process has it
    paths = [os.environ.get("PYTHONPATH", ""), str(FOUND_IN), str(Path(distributed.__file__).parents[1])]
    child = subprocess.Popen(
        [sys.executable, "-m", __name__, str(count)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
        # Ctrl-C reaches only the command, which ends this process
        start_new_session=os.name != "nt",
    )
    try:
        answer = child.stdout.readline() if child.stdout else ""
        if not answer:
            lines = (child.stderr.read() if child.stderr else "").split("\n")
            why = [line for line in lines if line.strip()][-1:] or ["no answer"]
            raise RunError(f"--cluster: no workers can be started ({why[0]}); correct this, or leave out --cluster")
        content = json.loads(answer)
        yield content["scheduler"], Security(require_encryption=True, **content["security"])
    finally:
        if child.stdin is not None:
            child.stdin.close()
        try:
            child.wait(CLOSE_SECONDS)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def main(count: int) -> None:
    """Act as the child process."""
    logging.disable(logging.CRITICAL)
    dask.config.set(CONFIGURATION)
    security = Security.temporary()
    # workers that are killed are started again by Dask
    with distributed.LocalCluster(
        n_workers=count,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        security=security,
        scheduler_kwargs=NO_DASHBOARD,
        memory_limit=0,
        silence_logs=logging.CRITICAL,
    ) as cluster:
        certificate = {name: getattr(security, name) for name in _CLIENT}
        sys.stdout.write(json.dumps({"scheduler": cluster.scheduler_address, "security": certificate}) + "\n")
        sys.stdout.flush()
        sys.stdin.read()
    # at once; the workers see it and end
    os._exit(0)


if __name__ == "__main__":
    main(int(sys.argv[1]))
