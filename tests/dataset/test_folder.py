"""The folder of a run: one writer, one identity, and nothing left behind that is not a dataset's."""

import errno
import json
import os
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest

from oneframe.dataset import layout
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.run import run_folder
from oneframe.dataset.run.run_folder import RunFolder, Shard
from oneframe.errors import InputError, RunError
from oneframe.files import lock
from oneframe.files.writing import partial_name

WHOLE = Shard()
IDENTITY = {"format": "1", "count": 3, "options": {"seed": 0, "scale": 1.0}, "inputs_sha256": {"frame": "ab"}}


def tree(folder: Path) -> dict[str, tuple[bytes, int]]:
    """Content and time of change of all files."""
    return {
        path.relative_to(folder).as_posix(): (path.read_bytes(), path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def leave_partial(target: Path) -> Path:
    """What a killed process leaves of a file that it was writing."""
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(f".partial-0123456789abcdef-{target.name}")
    partial.write_text("half")
    assert partial_name(partial.name) == target.name
    return partial


def write_record(folder: Path, index: int) -> Path:
    path = ViewPaths(folder, index).file("frame")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("{}")
    return path


@pytest.mark.parametrize(("one", "other"), [(WHOLE, WHOLE), (WHOLE, Shard(0, 2)), (Shard(1, 2), Shard(1, 2))], ids=str)
def test_two_runs_of_the_same_views_are_kept_apart(tmp_path, monkeypatch, one, other):
    monkeypatch.setattr(run_folder, "SHARDS_SECONDS", 0.2)
    with RunFolder(tmp_path, IDENTITY, one):
        before = tree(tmp_path)
        with pytest.raises(RunError, match="another process renders into this folder; wait for it, stop it, or choose"):
            RunFolder(tmp_path, IDENTITY, other)
        if other != one:
            with pytest.raises(RunError, match="another process"):
                RunFolder(tmp_path, IDENTITY, one)
        assert set(tree(tmp_path)) - {".work/lock-0-of-2"} == set(before)
    # the lock ended with the block
    with RunFolder(tmp_path, IDENTITY, other):
        pass


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no shared locks")
def test_shards_share_a_folder_and_the_last_one_tidies_up(tmp_path):
    with ExitStack() as stack:
        first, second, third = (stack.enter_context(RunFolder(tmp_path, IDENTITY, Shard(i, 3))) for i in range(3))
        live = leave_partial(tmp_path / "poses.csv")
        first.finish()
        second.finish()
        # the third one may be at work still
        assert live.exists()
        assert (tmp_path / ".work").exists()
        third.finish()
        assert sorted(tree(tmp_path)) == ["dataset.json"]


def test_a_lock_on_a_removed_file_is_none(tmp_path, monkeypatch):
    """A run that waits for the lock just as the dataset is finished must not take the dead file for the folder's."""
    removals, lock_by_system = iter((True, True, False)), lock.lock_by_system

    def lock_after_removal(descriptor: int, shared: bool) -> None:
        if next(removals):
            (tmp_path / ".work" / "lock").unlink()
        lock_by_system(descriptor, shared)

    with monkeypatch.context() as patch:
        patch.setattr(lock, "lock_by_system", lock_after_removal)
        folder = RunFolder(tmp_path, IDENTITY, WHOLE)
    with folder:
        assert next(removals, None) is None
        with pytest.raises(RunError, match="another process"):
            RunFolder(tmp_path, IDENTITY, WHOLE)


USERS_FILES = ("models/mine.obj", "models/.partial-0123456789abcdef-mine.obj", "camera.json", "train_synt/notes.txt")


@pytest.mark.parametrize("work", [".work/lock", "work/notes.txt"])
def test_a_folder_of_somebody_else_is_refused_untouched(tmp_path, work):
    """Also one that holds what looks like the folder of a stopped run."""
    for name in (work, *USERS_FILES):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    before = tree(tmp_path)
    with pytest.raises(RunError, match="found other files"):
        RunFolder(tmp_path, IDENTITY, WHOLE)
    assert tree(tmp_path) == before


def test_files_put_beside_those_of_a_run_survive_its_end_and_its_failure(tmp_path):
    """Nothing is removed but what a run writes, whatever the ending; not even the temporary file of another program."""
    names = ("models/mine.obj", ".partial-notes", ".partial-0123456789abcdef-frame.ply", ".work/mine", "video/a.mp4")

    def end(error: Exception | None) -> None:
        with RunFolder(tmp_path, IDENTITY, WHOLE) as folder:
            for name in (*names, "models/models_info.json", "camera.json"):
                (tmp_path / name).parent.mkdir(exist_ok=True)
                (tmp_path / name).write_text(name)
            if error is None:
                folder.finish()
            else:
                raise error

    with pytest.raises(InputError):
        end(InputError("bad"))
    assert sorted(tree(tmp_path)) == sorted(names)
    for name in names:
        (tmp_path / name).unlink()
    for name in ("models", ".work", "video"):
        (tmp_path / name).rmdir()
    end(None)
    assert sorted(tree(tmp_path)) == sorted([*names, "models/models_info.json", "camera.json", "dataset.json"])


# --- damage, growth, file systems without locks ----------------------------------------------------------------------


@pytest.mark.parametrize("damage", [b"", b'{"format": "1", ', bytes(99), b"[1]"])
def test_a_damaged_description_is_refused(tmp_path, damage):
    with RunFolder(tmp_path, IDENTITY, WHOLE):
        write_record(tmp_path, 0)
    (tmp_path / "dataset.json").write_bytes(damage)
    with pytest.raises(RunError, match="expected the description of a dataset, cannot read one; copy it again"):
        RunFolder(tmp_path, IDENTITY, WHOLE)


@pytest.mark.parametrize("kind", layout.KINDS)
def test_a_run_knows_its_files_of_a_view_and_no_others(kind):
    name = ViewPaths(Path(), 1002).relative(kind)
    assert layout.is_own_file(name)
    for other in (f"{name}~", name.replace("000002", "2"), str(Path(name).with_suffix(".jpg"))):
        assert not layout.is_own_file(other)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no shared locks")
def test_a_dataset_does_not_grow_under_a_running_shard(tmp_path, monkeypatch):
    monkeypatch.setattr(run_folder, "SHARDS_SECONDS", 0.2)
    larger = IDENTITY | {"count": 300}
    with RunFolder(tmp_path, IDENTITY, Shard(0, 2)):
        with pytest.raises(RunError, match="another process"):
            RunFolder(tmp_path, larger, Shard(1, 2))
        assert json.loads((tmp_path / "dataset.json").read_text()) == IDENTITY
    monkeypatch.undo()
    together = threading.Barrier(6)

    def start(index: int) -> None:
        folder = RunFolder(tmp_path, larger, Shard(index, 6))
        together.wait(20)
        with folder:
            assert json.loads((tmp_path / "dataset.json").read_text()) == larger

    with ThreadPoolExecutor(6) as pool:
        assert [*pool.map(start, range(6))] == [None] * 6


def test_without_locks_of_the_system_shards_share_a_folder_all_the_same(tmp_path, monkeypatch):
    def no_locks(descriptor: int, shared: bool) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(lock, "lock_by_system", no_locks)
    with RunFolder(tmp_path, IDENTITY, Shard(0, 2)) as first, RunFolder(tmp_path, IDENTITY, Shard(1, 2)) as second:
        first.finish()
        second.finish()
    assert sorted(tree(tmp_path)) == ["dataset.json"]


@pytest.mark.parametrize("error", [InputError("bad"), RunError("bad")], ids=repr)
@pytest.mark.parametrize("existing", ["", "deep", "deep/out"])
def test_a_refusal_before_the_first_view_leaves_nothing_behind(tmp_path, existing, error):
    (tmp_path / existing).mkdir(parents=True, exist_ok=True)
    out = tmp_path / "deep" / "out"

    def stopped() -> None:
        with RunFolder(out, IDENTITY, WHOLE):
            (out / "camera.json").write_text("{}")
            (out / "models").mkdir()
            raise error

    with pytest.raises(type(error), match="bad"):
        stopped()
    assert (tmp_path / existing).is_dir()
    assert sorted(tmp_path.rglob("*")) == sorted(
        tmp_path / part for part in ("deep", "deep/out") if existing.startswith(part)
    )


def test_a_disk_that_is_full_from_the_start_is_left_empty(tmp_path, monkeypatch):
    def full(path: Path, _: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(run_folder, "write_bytes_atomically", full)
    with pytest.raises(RunError, match="cannot write to the folder"):
        RunFolder(tmp_path / "out", IDENTITY, WHOLE)
    assert not [*tmp_path.iterdir()]


def test_finished_views_stay_if_the_run_that_goes_on_is_refused(tmp_path):
    def refused() -> None:
        with RunFolder(tmp_path, IDENTITY, WHOLE):
            write_record(tmp_path, 1)
            raise InputError("bad")

    with pytest.raises(InputError):
        refused()
    assert ViewPaths(tmp_path, 1).file("frame").exists()
