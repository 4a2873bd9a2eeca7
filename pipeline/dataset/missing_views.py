"""What a run asks of whoever renders its missing views elsewhere, such as on the workers of a cluster."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

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
    description
        The content of ``dataset.json``: see :func:`oneframe.dataset.description.describe`.
    identity
        The identity of the dataset: see :func:`oneframe.dataset.identity.identity_of`.
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
    description: Mapping[str, object]
    identity: str
    kinds: tuple[str, ...]
    finished: int
    views: tuple[int, ...]
    damaged: frozenset[int]


Elsewhere = Callable[[MissingViews, Progress], None]
"""Renders the missing views of a run into its folder, and counts them; it raises ``InputError`` if a view cannot be
rendered from this input, and ``RunError`` if the views cannot be finished. Those that are finished stay."""
