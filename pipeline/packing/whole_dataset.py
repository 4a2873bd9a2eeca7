"""The folder of a complete dataset, from which views are packed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..dataset.checksums import Checksums, damaged_file, read_checksums
from ..dataset.dataset_file import Description, read_description
from ..dataset.layout import CHECKSUMS, RECORD, VIEWS_PER_SCENE, check_is_dataset
from ..dataset.run.survey import unrecorded_views, view_ranges
from ..errors import InputError
from ..files.content import read_content
from ..files.tables import parsed_json
from .layout import COPIED, TARGETS

AGAIN = "run the command that rendered it again"


@dataclass(frozen=True)
class WholeDataset:
    """A dataset that is complete, as far as names tell: ``dataset.json`` and ``checksums.json`` of a folder."""

    root: Path
    description: Description
    sums: Checksums

    @property
    def targets(self) -> frozenset[int]:
        """The views that ``test_targets_bop19.json`` names."""
        return frozenset(entry["scene_id"] * VIEWS_PER_SCENE + entry["im_id"] for entry in self.table(TARGETS))

    def table(self, name: str) -> Any:
        """The value in a JSON file beside the views, which is the one that the run has written."""
        self.check(name)
        return parsed_json(read_content(self.root / name, "a table of the dataset"), name)

    def check(self, name: str) -> None:
        """Check that a file is the one that ``checksums.json`` lists."""
        known = self.sums.files.get(name)
        problem = f"{name} is not among them" if known is None else damaged_file(self.root, name, known, hashes=True)
        if problem is not None:
            raise InputError(
                f"{self.root}: expected the files that {CHECKSUMS} lists, but {problem}; remove the file, and {AGAIN}"
            )


def open_whole_dataset(root: Path) -> WholeDataset:
    """Open the folder of a complete dataset, whose files beside the views are those that the run has written."""
    check_is_dataset(root)
    description = read_description(root / RECORD)
    missing = unrecorded_views(root, description.count)
    if missing:
        raise InputError(
            f"{root}: expected {description.count} views, found {description.count - len(missing)}: views "
            f"{view_ranges(missing)} are missing; {AGAIN}, or copy the folder of their shard into this one first"
        )
    sums = read_checksums(root, description.identity)
    if sums is None:
        raise InputError(
            f"{root}: expected a complete dataset, found no {CHECKSUMS} of it, which is written last; {AGAIN}"
        )
    dataset = WholeDataset(root, description, sums)
    for name in (*COPIED, TARGETS):
        dataset.check(name)
    for folder in description.further:
        description.read_further(root, folder)
    return dataset
