"""A real Slurm on this machine, from its configuration to its end: controller, nodes, keys and ports of its own."""

import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

NEEDED = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "scancel")
NODES = ("n1", "n2")
BLIND_NODE = "n3"
"""A node alone in the partition "blind": it does not see the folder :attr:`Slurm.unshared`."""
LARGEST_ARRAY = 101
ADMIN_PATH = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"

CONFIGURATION = """\
ClusterName=oneframe
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
CryptoType=crypto/munge
# the second: requeued jobs wait as long as credentials live, 2 minutes by default
AuthInfo=socket={root}/munge.sock,cred_expire=5
StateSaveLocation={root}/state
SlurmdSpoolDir={root}/spool-%n
SlurmctldPidFile={root}/slurmctld.pid
SlurmdPidFile={root}/slurmd-%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SwitchType=switch/none
MpiDefault=none
SchedulerParameters=sched_interval=1,batch_sched_delay=0,sched_min_interval=10000,bf_interval=1
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
MaxArraySize={largest_array}
KillWait=2
CompleteWait=0
MinJobAge=600
ReturnToService=2
PropagateResourceLimits=NONE
NodeName=n[1-3] NodeAddr=127.0.0.1 NodeHostname={host} Port=[{ports[1]}-{ports[3]}] CPUs={cpus} RealMemory=4000
PartitionName=main Nodes=n[1-2] Default=YES State=UP
PartitionName=blind Nodes=n3 State=UP
"""


class CannotRun(Exception):
    """There is no Slurm here, or it does not run; the text says why."""


class Slurm:
    """A controller and three nodes, until :meth:`stop`.

    Attributes
    ----------
    environment
        Environment variables for the programs that talk to it.
    unshared
        A folder that the node of the partition "blind" sees empty, whatever is in it here; ``None`` where nodes cannot
        have a view of their own of the file system.
    """

    def __init__(self) -> None:
        """Start it and wait until the nodes can take jobs.

        Raises
        ------
        CannotRun
            A program is missing, or something does not start.
        """
        missing = [name for name in NEEDED if shutil.which(name, path=ADMIN_PATH) is None]
        if missing:
            raise CannotRun(f"no {', '.join(missing)} here (Debian: slurm-wlm, munge)")
        # a short path: it holds a socket
        self.root = Path(tempfile.mkdtemp(prefix="oneframe-slurm-", dir="/tmp"))
        self.environment = {"SLURM_CONF": str(self.root / "slurm.conf")}
        self.unshared: Path | None = self.root / "unshared"
        self.unshared.mkdir()
        self._daemons: dict[str, subprocess.Popen[bytes]] = {}
        try:
            self._start()
        except BaseException:
            self.stop()
            raise

    def _start(self) -> None:
        root = self.root
        (root / "state").mkdir()
        key = root / "munge.key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o600)
        root.chmod(0o755)  # munge refuses folders that others may write to
        (root / "slurm.conf").write_text(
            CONFIGURATION.format(
                root=root,
                host=socket.gethostname().partition(".")[0],
                user=subprocess.run(["id", "-un"], capture_output=True, text=True, check=True).stdout.strip(),
                ports=_free_ports(4),
                largest_array=LARGEST_ARRAY,
                cpus=os.cpu_count(),
            )
        )
        files = [f"--{name}={root}/munge.{name.partition('-')[0]}" for name in ("pid-file", "log-file", "seed-file")]
        self._run("munged", "--foreground", "--force", f"--key-file={key}", f"--socket={root}/munge.sock", *files)
        _wait(lambda: (root / "munge.sock").exists(), "munged does not start")
        self._run("slurmctld", "-D", "-c")
        for node in (*NODES, BLIND_NODE):
            self.start_node(node)
        states = ("sinfo", "-h", "-N", "-o", "%N %T")
        _wait(lambda: self.call(*states).count(" idle") >= len(NODES) + 1, "the nodes of Slurm do not come up")

    def start_node(self, node: str) -> None:
        """Start the daemon of a node, again or for the first time."""
        command = ["slurmd", "-D", "-N", node]
        if node == BLIND_NODE:
            blind = ["unshare", "--mount", "sh", "-c", f'mount -t tmpfs none {self.unshared} && exec "$@"', "sh"]
            can = (
                subprocess.run([*blind, "true"], capture_output=True, check=False) if shutil.which("unshare") else None
            )
            if can is None or can.returncode != 0:
                self.unshared = None
            else:
                command = [*blind, *command]
        self._run(*command, name=node)

    def call(self, *command: str) -> str:
        """The output of one of Slurm's programs."""
        ended = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | self.environment)
        return ended.stdout

    def running(self) -> dict[str, tuple[str, str]]:
        """Jobs that run, the elements of arrays one by one: its own number -> as Slurm's commands name it, and node.

        The own number of one element is also the name of the whole array.
        """
        lines = [line.split() for line in self.call("squeue", "-h", "-r", "-t", "R", "-o", "%A %i %N").splitlines()]
        return {line[0]: (line[1], line[2]) for line in lines if len(line) == 3}

    def wait_until_idle(self, seconds: float = 600) -> None:
        """Wait until no job is in the queue."""
        try:
            _wait(lambda: not self.call("squeue", "-h").strip(), "jobs are still in the queue", seconds)
        except CannotRun as error:
            raise CannotRun(f"{error}\n{self.told()}") from None

    def told(self) -> str:
        """The queue, and the ends of the logs of all daemons, for messages."""
        logs = [path.read_text()[-4000:] for path in sorted(self.root.glob("*.log"))]
        return "\n".join([self.call("squeue", "-r", "-l"), *logs])

    def cancel_all(self) -> None:
        """Empty the queue."""
        self.call("scancel", "--user", str(os.getuid()))
        self.wait_until_idle(20)

    def processes(self, **variables: str) -> dict[int, str]:
        """The processes of jobs with these environment variables: number -> command line."""
        found = {}
        wanted = {"SLURM_CONF": f"{self.root}/slurm.conf", **variables}
        marks = {f"{name}={value}".encode() for name, value in wanted.items()}
        for folder in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                if marks <= set((folder / "environ").read_bytes().split(b"\0")):
                    found[int(folder.name)] = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        return found

    def kill(self, job: str, only: str = "") -> int:
        """Kill the processes of a job whose command lines contain ``only``; returns how many."""
        numbers = [number for number, line in self.processes(SLURM_JOB_ID=job).items() if only in line]
        return _kill(numbers)

    def fail_node(self, node: str) -> None:
        """Take a node's power: its daemon ends, and all jobs with the processes that watch them. Then it comes back."""
        inside = self.processes(SLURMD_NODENAME=node)
        watchers = {_parent(number) for number in inside} - set(inside) - {1}
        self._daemons.pop(node).kill()
        _kill([*watchers, *inside])
        # the controller would find out itself, after minutes (SlurmdTimeout)
        self.call("scontrol", "update", f"NodeName={node}", "State=DOWN", "Reason=power")
        self.start_node(node)
        self.call("scontrol", "update", f"NodeName={node}", "State=RESUME")

    def stop(self) -> None:
        """End all jobs and daemons and remove all files."""
        if "slurmctld" in self._daemons:
            with suppress(CannotRun):
                self.cancel_all()
        for name in reversed(list(self._daemons)):
            daemon = self._daemons.pop(name)
            daemon.terminate()
            try:
                daemon.wait(5)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()
        shutil.rmtree(self.root, ignore_errors=True)

    def _run(self, *command: str, name: str = "") -> None:
        environment = os.environ | self.environment | {"PATH": ADMIN_PATH}
        with (self.root / f"{name or command[0]}.log").open("ab") as log:
            self._daemons[name or command[0]] = subprocess.Popen(command, stdout=log, stderr=log, env=environment)


def _free_ports(count: int) -> list[int]:
    """Consecutive numbers of ports that nobody uses."""
    for first in range(20000 + os.getpid() % 1000 * 8, 32000, count):
        try:
            for port in range(first, first + count):
                with socket.socket() as one:
                    one.bind(("127.0.0.1", port))
        except OSError:
            continue
        return list(range(first, first + count))
    raise CannotRun("there are no free ports")


def _parent(number: int) -> int:
    with suppress(OSError):
        return int(Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[1])
    return 1


def _kill(numbers: Iterable[int]) -> int:
    killed = 0
    for number in numbers:
        with suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)
            killed += 1
    return killed


def _wait(until: Callable[[], bool], otherwise: str, seconds: float = 120) -> None:
    end = time.monotonic() + seconds
    while not until():
        if time.monotonic() > end:
            raise CannotRun(otherwise)
        time.sleep(0.1)
