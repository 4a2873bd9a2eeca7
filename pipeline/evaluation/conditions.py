"""Under which conditions figures were measured: machine, versions and configuration, at the head of every table."""

import csv
import importlib.metadata
import io
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from .. import __version__
from ..files.outputs import write_output

COMMENT = "# "
"""Begins each line of the conditions in a table (CSV)."""
PACKAGES = ("numpy", "opencv-contrib-python-headless", "scikit-image", "pyvista", "vtk", "torch")
"""Those whose versions are kept, where they are installed."""


@dataclass(frozen=True)
class Conditions:
    """Machine, versions and configuration of a measurement.

    Attributes
    ----------
    machine
        Processor, number of cores, memory and system, as one line.
    versions
        Version by name: OneFrame, Python, Blender and packages.
    configuration
        What the measurement was asked for: seed, counts, options; values with a plain ``str``.
    measured
        Day of the measurement (UTC), ISO 8601.
    """

    machine: str
    versions: Mapping[str, str]
    configuration: Mapping[str, object] = field(default_factory=dict)
    measured: str = ""

    def lines(self) -> list[str]:
        """One line each for machine, versions, configuration and day, for the head of a table."""
        parts = {
            "machine": self.machine,
            "versions": ", ".join(f"{name} {version}" for name, version in self.versions.items()),
            "configuration": ", ".join(f"{name} {value}" for name, value in self.configuration.items()),
            "measured": self.measured,
        }
        return [f"{name}: {' '.join(text.split())}" for name, text in parts.items() if text]


def current_conditions(configuration: Mapping[str, object], *, blender: str | None = None) -> Conditions:
    """The conditions here and now.

    ``blender`` is its version if it takes part: this package does not import it.
    """
    versions = {"OneFrame": __version__, "Python": platform.python_version()}
    if blender is not None:
        versions["Blender"] = blender
    for name in PACKAGES:
        with suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    return Conditions(_machine(), versions, dict(configuration), datetime.now(UTC).date().isoformat())


def _machine() -> str:
    cores = os.cpu_count() or 1
    parts = [f"{cores} core{'s' * (cores > 1)} of {_processor()}"]
    with suppress(OSError, ValueError, IndexError):
        total_kb = int(Path("/proc/meminfo").read_text().split("MemTotal:")[1].split()[0])
        parts.append(f"{total_kb / 2**20:.0f} GB")
    parts.append(f"{platform.system()} {platform.machine()}")
    return ", ".join(parts)


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or "an unknown processor"


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]], conditions: Conditions) -> None:
    """Write a table below its conditions, whole or not at all; floats keep six significant digits."""
    text = io.StringIO(newline="")
    text.writelines(f"{COMMENT}{line}\n" for line in conditions.lines())
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows([f"{value:.6g}" if isinstance(value, float) else value for value in row] for row in rows)
    write_output(path, text.getvalue().encode())
