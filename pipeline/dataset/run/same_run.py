"""Whether the dataset on disk is that of a run: by its description, and by the records of its views."""

import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import RunError
from ...files.content import LARGEST_TEXT, read_file
from .. import layout
from ..identity import (
    COUNT,
    DEPTH_SCALE,
    LISTED,
    POSES_HASH,
    Difference,
    described,
    differences,
    identity_of,
    poses_hash,
    short,
)
from ..layout import FORMAT, RECORD, ViewPaths, occupied_views
from .resume_record import read_record


def check_description(
    root: Path,
    description: Mapping[str, Any],
    poses: np.ndarray | None = None,
    *,
    may_shrink: bool = True,
    advice: str = "undo the change to resume it, or choose another folder (--out)",
) -> None:
    """Check that a dataset on disk belongs to a run, and has no views beyond those that the run wants.

    Parameters
    ----------
    root
        The dataset's folder; nothing is checked if it has no ``dataset.json``.
    description
        Everything that the run's content depends on; JSON types only.
    poses
        ``(N, 4, 4)`` listed ``cam_from_model``, mm, or ``None`` if the poses are drawn. Those of the views that the
        dataset was started for must be the same.
    may_shrink
        Whether the dataset may have been started for more views, none of which exists.
    advice
        What to do if the two differ.
    """
    record = root / RECORD
    try:
        content = read_file(record, LARGEST_TEXT)
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        raise RunError(
            f"{record}: expected the description of a dataset, cannot read it ({error.strerror}); "
            "choose another folder (--out)"
        ) from None
    try:
        existing = json.loads(content)
    except (ValueError, RecursionError):
        raise RunError(
            f"{record}: expected a dataset's description, found no JSON; remove it and run the same command again, "
            "which writes it if the views are of this run, or choose another folder (--out)"
        ) from None
    if not isinstance(existing, dict):
        raise RunError(
            f"{record}: expected the description of a dataset, found {short(existing)}; choose another folder (--out)"
        )
    if existing.get("format") != FORMAT == description.get("format"):
        raise RunError(
            f"{root}: expected a dataset of the format {FORMAT!r}, found {short(existing.get('format'))} of another "
            "version of OneFrame; use that version, or choose another folder (--out)"
        )
    changes = run_differences(root, existing, description, poses)
    if changes:
        raise RunError(f"{root}: the folder holds the dataset of another run ({_first(described(changes))}); {advice}")
    had = existing.get(COUNT)
    check_count(root, description, had if isinstance(had, int) and not may_shrink else 0)


def check_count(root: Path, description: Mapping[str, Any], had: int = 0) -> None:
    """Raise RunError if a run wants fewer views than the ``had`` that a dataset must keep, or than those on disk.

    If a run of more views was stopped early, there are fewer than it was started for, and with a shard more.
    """
    wanted, least = description[COUNT], max(occupied_views(root), had)
    if wanted < least:
        raise RunError(
            f"{root}: the folder holds a dataset of {least} views, and {wanted} are wanted: a dataset may grow, but no "
            f"view is removed; set the number of views to {least} or more, or choose another folder (--out)"
        )


def holds_views_of(root: Path, description: Mapping[str, object], poses: np.ndarray | None) -> bool:
    """Whether all views on disk are of a run, and there are some, by their records alone; damaged ones tell nothing."""
    identity, found = identity_of(description), False
    six_digits = "[0-9]" * 6
    for path in (root / layout.SPLIT).glob(f"{six_digits}/frame/{six_digits}.json"):
        index = int(path.parts[-3]) * layout.VIEWS_PER_SCENE + int(path.stem)
        with suppress(RunError):
            record = read_record(ViewPaths(root, index), with_mask=False)
            listed = record.cam_from_model if poses is None or index >= len(poses) else poses[index]
            if record.identity != identity or not np.array_equal(record.cam_from_model, listed):
                return False
            found = True
    return found


def run_differences(
    root: Path, existing: Mapping[str, object], description: Mapping[str, object], poses: np.ndarray | None
) -> list[Difference]:
    """What keeps a run from going on with a dataset on disk, by its description and the poses of its views."""
    changes = differences(existing, description)
    had, known = existing.get(COUNT), existing.get(POSES_HASH)
    # poses are those of the model, so they follow from other changes; the scale of the depth images follows from them
    if poses is None or known is None or any(change.key != DEPTH_SCALE for change in changes):
        return changes
    if not isinstance(had, int) or had > len(poses) or known == poses_hash(poses[:had]):
        return changes
    return [_changed_pose(root, poses[:had])]


def _changed_pose(root: Path, poses: np.ndarray) -> Difference:
    """The first view on disk whose pose is not the listed one; without a number if there is none."""
    for index, pose in enumerate(poses):
        with suppress(RunError):
            known = read_record(ViewPaths(root, index), with_mask=False).cam_from_model
            if not np.array_equal(known, pose):
                return Difference(f"{LISTED}.{index}", known.tolist(), pose.tolist())
    return Difference(LISTED, None, None)


def _first(differences: Iterable[str]) -> str:
    clauses = [*differences]
    return "; ".join(clauses[:4]) + (f" and {len(clauses) - 4} more" if len(clauses) > 4 else "")
