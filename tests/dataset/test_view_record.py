"""A record comes back as it was; a damaged one is refused by the name of its file and of what is wrong in it."""

import json
import os
import re
import shutil
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oneframe.dataset.identity import identity_of
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.run.resume_record import ViewRecord
from oneframe.dataset.run.survey import survey_views
from oneframe.dataset.view import ViewWriter, file_sums
from oneframe.errors import RunError
from tests.dataset.blank_dataset import record_of, write_view

WHERE = "dataset/frame/000002.json"
CONTENT = record_of(2).to_json() | {"files": {"rgb/000002.png": {"sha256": "00" * 32, "bytes": 7}}}


PLACES = [(key,) for key in CONTENT] + [("gt_info", key) for key in CONTENT["gt_info"]] + [("rejections", "observed")]
WRONG = [None, "text", [1, -2.5], ["a"], [[1] * 9], {"a": 1}, [1.5] * 4]
MISSING = object()


@pytest.mark.parametrize("place", PLACES, ids=lambda place: place[-1])
def test_a_missing_or_wrong_value_is_refused_by_the_name_of_the_file(place):
    for wrong in [MISSING, *WRONG]:
        content = json.loads(json.dumps(CONTENT))
        table = content
        for key in place[:-1]:
            table = table[key]
        del table[place[-1]]
        if wrong is not MISSING:
            table[place[-1]] = wrong
        with pytest.raises(RunError, match="remove the file and run the same command again") as caught:
            ViewRecord.from_json(content, WHERE)
        assert str(caught.value).startswith(f"{WHERE}: expected ")


class Disk:
    """A folder as a loss of power leaves it: what was flushed, and of the rest nothing, or names with zeros."""

    def __init__(self, root, check):
        self.root, self.check, self.lock = root, check, threading.Lock()
        self.contents, self.names, self.kept = {}, {}, []

    def flush(self, descriptor):
        with self.lock:
            self.check(self)
            # as long as it is open, no other file gets its number
            self.kept.append(os.dup(descriptor))
            path = Path(os.readlink(f"/proc/self/fd/{descriptor}"))
            if path.is_dir():
                self.names[path] = {entry.name: entry.inode() for entry in os.scandir(path) if entry.is_file()}
            else:
                self.contents[path.stat().st_ino] = path.read_bytes()

    def left(self, folder, *, names):
        """The tree after a cut now; ``names``: also those that were not flushed."""
        shutil.rmtree(folder, ignore_errors=True)
        for path in [path for path in self.root.rglob("*") if path.is_dir()]:
            flushed = self.names.get(path, {})
            now = {entry.name: entry.inode() for entry in os.scandir(path) if entry.is_file()}
            new = folder / path.relative_to(self.root)
            new.mkdir(parents=True, exist_ok=True)
            for name, number in (flushed | now if names else flushed).items():
                size = (path / name).stat().st_size if names and (path / name).exists() else 0
                (new / name).write_bytes(self.contents.get(number, bytes(size)))


@pytest.mark.skipif(sys.platform != "linux", reason="asks the system for the name of an open file")
def test_a_view_that_counts_as_finished_after_a_power_cut_is_whole(tmp_path, monkeypatch):
    """Cut before every flush, for new views and for one that was damaged; what was reported as finished stays so."""
    root, cut, description = tmp_path / "dataset", tmp_path / "cut", {"count": 9, "seed": 1}
    files, reported, again = {"rgb": b"picture", "depth": b"numbers"}, set(), set()

    def check(disk):
        for names in (False, True):
            disk.left(cut, names=names)
            finished = survey_views(cut, range(9), description, tuple(files)).finished
            assert reported - again <= finished
            for paths in (ViewPaths(cut, index) for index in finished):
                assert {kind: paths.file(kind).read_bytes() for kind in files} == files
        return len(finished)

    disk = Disk(root, check)
    monkeypatch.setattr(os, "fsync", disk.flush)
    writer = ViewWriter(reported.add)

    def write(index):
        paths = ViewPaths(root, index)
        record = replace(record_of(index), identity=identity_of(description), files=file_sums(paths, files))
        writer.write(paths, files, record)
        check(disk)

    for index in range(5):
        write(index)
        if index == 2:
            writer.settle()
    assert check(disk) == 3
    writer.settle()
    again.add(1)
    ViewPaths(root, 1).file("rgb").unlink()
    write(1)
    assert check(disk) == 4
    writer.settle()
    again.clear()
    assert check(disk) == 5


def test_whatever_is_left_of_a_record_is_no_view(tmp_path):
    """Cut off, zeroed from anywhere, or damaged: not finished, and never another error; a whole one is."""
    paths, files = ViewPaths(tmp_path, 7), {"rgb": b"picture"}
    description = {"count": 9, "seed": 1}
    record = replace(record_of(7), identity=identity_of(description))
    write_view(paths, files, record)

    def finished() -> set[int]:
        return survey_views(tmp_path, range(9), description, ("rgb",)).finished

    whole, rng = paths.file("frame").read_bytes(), np.random.default_rng(3)
    assert finished() == {7}
    for cut in range(0, len(whole), 11):
        for data in (whole[:cut], whole[:cut] + bytes(len(whole) - cut)):
            paths.file("frame").write_bytes(data)
            assert finished() == set()
    for _ in range(80):
        first, last = sorted(rng.integers(0, len(whole) + 1, 2))
        data = whole[:first] + rng.bytes(last - first) + whole[last:]
        paths.file("frame").write_bytes(data)
        assert finished() <= {7}
        assert not finished() or data == whole or first >= whole.index(b"rle_counts")
    for number in ("1" + "0" * 400, "NaN", "-Infinity", "1e999", "9" * 5000):
        data = re.sub(rb'"depth_scale":[^,]+', b'"depth_scale":' + number.encode(), whole)
        paths.file("frame").write_bytes(data)
        assert finished() == set()
