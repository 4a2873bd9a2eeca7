"""What a run asks of whoever renders its missing views elsewhere, such as on the workers of a cluster."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from ..progress import Progress
from .options import DatasetOptions


@dataclass(frozen=True)
class MissingViews:
    """The views that a run lacks, and all that is needed to render them into its folder.

    Attributes
    ----------
    case, out
        The case file and the dataset's folder.
    options
        The options of the run.
    identity
        The identity of the dataset: see :func:`pipeline.dataset.identity.identity_of`.
    kinds
        Kinds of files of a view, beside its record.
    finished
        Number of views that are there.
    views
        The missing views.
    damaged
        Those of them that have files all the same; they are rendered whatever is on disk.
    """

    case: Path
    out: Path
    options: DatasetOptions
    identity: str
    kinds: tuple[str, ...]
    finished: int
    views: tuple[int, ...]
    damaged: frozenset[int]


class ViewPool(Protocol):
    """Renders the missing views of a run, while the run prepares its tables."""

    messages: list[str]
    """What there is to say at the end."""

    def start(self, missing: MissingViews, progress: Progress) -> None:
        """Begin, in the background."""

    def wait(self) -> None:
        """Wait until all views are on disk.

        Raises
        ------
        InputError
            A view cannot be rendered from this input.
        RunError
            The views cannot be finished; those that are stay.
        """

    def stop(self) -> None:
        """End all that still renders, at once."""
