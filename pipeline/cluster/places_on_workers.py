"""Where the workers of a run find its case and write its views, if not where its own machine does."""

import os
from dataclasses import dataclass
from pathlib import Path, PurePosixPath


@dataclass(frozen=True)
class PlacesOnWorkers:
    """What differs on the workers' machines.

    Attributes
    ----------
    case
        Path of the case file there; ``None`` for the same as here.
    send_case
        Whether the case is sent to each worker.
    out
        A folder that each worker writes to; ``None`` for the run's own, which all see, or, with ``gather``, for one
        among the worker's temporary files.
    gather
        Whether the views are brought from there into the run's folder.
    """

    case: str | None = None
    send_case: bool = False
    out: str | None = None
    gather: bool = False

    @property
    def are_own(self) -> bool:
        """Whether workers write to folders of their own."""
        return self.gather or self.out is not None

    def poses(self, poses: str, case: Path) -> str:
        """Path of the list of poses there: beside the case file if it is here."""
        here, folder = os.path.abspath(poses), os.path.dirname(os.path.abspath(case))
        if self.case is None or os.path.commonpath([here, folder]) != folder:
            return here
        return str(PurePosixPath(self.case).parent / PurePosixPath(os.path.relpath(here, folder)))
