"""A scheduler with workers of its own, on this machine or in jobs of Slurm, run by a child process.

Child and workers end when its standard input ends, also if its parent is killed. Whoever connects to a scheduler or
worker of Dask can run code there: so the child makes a certificate that only its parent and its workers get. The child
is a plain Python also where a Blender program renders, whose start-up code does not bear Python's ``multiprocessing``.
"""

import json
import logging
import os
import shlex
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import dask
import distributed
from distributed.security import Security
from distributed.utils import get_ip, get_ip_interface

from ..errors import RunError

CLOSE_SECONDS = 20.0
REPLACE_SECONDS = 3.0
"""How often jobs that have ended are replaced."""
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
def own_workers(settings: Mapping[str, Any], where: str) -> Iterator[tuple[str, Security]]:
    """Start workers, which end with the context: ``{"local": number}``, or the settings of jobs of Slurm.

    Yields
    ------
    Address of the scheduler, and what it admits a client by.

    Raises
    ------
    RunError
        They cannot be started, or Slurm refuses the first job; ``where`` begins the message.
    """
    # Dask is there where this process has it
    paths = [os.environ.get("PYTHONPATH", ""), str(FOUND_IN), str(Path(distributed.__file__).parents[1])]
    child = subprocess.Popen(
        [sys.executable, "-m", __name__, json.dumps(settings)],
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
            raise RunError(f"{where}: no workers can be started ({why[0]}); correct this, or leave out --cluster")
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


def main(settings: dict[str, Any]) -> None:
    """Act as the child process."""
    logging.disable(logging.CRITICAL)
    dask.config.set(CONFIGURATION)
    security, ended, jobs = Security.temporary(), threading.Event(), settings.get("jobs")
    with ExitStack() as opened:
        cluster = _slurm(settings, security, opened) if jobs else _local(settings["local"], security)
        certificate = {name: getattr(security, name) for name in _CLIENT}
        sys.stdout.write(json.dumps({"scheduler": cluster.scheduler_address, "security": certificate}) + "\n")
        sys.stdout.flush()

        def watch() -> None:
            sys.stdin.read()
            ended.set()

        threading.Thread(target=watch, daemon=True).start()
        while jobs and not ended.is_set():
            # only what is missing is submitted
            cluster.scale(jobs=jobs)
            ended.wait(REPLACE_SECONDS)
        ended.wait()
    # at once; local workers see it and end
    os._exit(0)


def _local(count: int, security: Security) -> distributed.LocalCluster:
    """Workers of one thread on this machine, which Dask starts again if they are killed."""
    return distributed.LocalCluster(
        n_workers=count,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        security=security,
        scheduler_kwargs=NO_DASHBOARD,
        memory_limit=0,
        silence_logs=logging.CRITICAL,
    )


def _slurm(settings: Mapping[str, Any], security: Security, opened: ExitStack) -> Any:
    """Workers in jobs, which are cancelled as the process ends; those that have lost their scheduler end as well.

    All listen on one address each: the scheduler on that of an interface, a worker on the one that leads to it.
    """
    from dask_jobqueue import SLURMCluster

    shared = dask.config.get("jobqueue.slurm.shared-temp-directory", None) or "~"
    home = os.path.expanduser(os.path.expandvars(shared))
    keys = opened.enter_context(
        tempfile.TemporaryDirectory(prefix=".oneframe-keys-", dir=home, ignore_cleanup_errors=True)
    )
    interface = settings["interface"] or dask.config.get("jobqueue.slurm.interface")
    host, python = get_ip_interface(interface) if interface else get_ip(), shlex.quote(sys.executable)
    own = ["--job-name=oneframe-workers", "--output=/dev/null", "--error=/dev/null"]
    cluster = SLURMCluster(
        **{name: settings[name] for name in ("queue", "account", "walltime", "cores", "memory")},
        # a worker of one thread for each: one process renders on each core
        processes=settings["cores"],
        # nodes take the one that leads to the scheduler, whatever its name is there
        interface="",
        security=security,
        shared_temp_directory=keys,
        job_extra_directives=[*own, *settings["options"]],
        job_script_prologue=[
            # the nodes find this program where this machine has it
            f"export PYTHONPATH='{os.environ['PYTHONPATH']}' DASK_DISTRIBUTED__WORKER__HTTP__ROUTES='[]'",
            f"""host=$({python} -c 'from distributed.utils import get_ip; print(get_ip("{host}"))')""",
        ],
        worker_extra_args=[
            # Slurm watches the memory, most of which is that of processes which the worker starts
            *("--memory-limit", "0"),
            *("--host", "$host", "--no-dashboard", "--dashboard-address", str(NO_DASHBOARD["dashboard_address"])),
        ],
        scheduler_options=NO_DASHBOARD | {"host": host},
        death_timeout=120,
    )
    opened.callback(cluster.close, timeout=CLOSE_SECONDS / 2)
    # what Slurm says against a job, without submitting it
    test = ["sbatch", "--test-only"]
    checked = subprocess.run(test, input=cluster.job_script(), capture_output=True, text=True, check=False)
    if checked.returncode != 0:
        raise SystemExit(f"Slurm refuses a job of these settings: {' '.join(checked.stderr.split())}")
    return cluster


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
