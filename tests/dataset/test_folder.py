"""The folder of a run: one writer, one identity, and nothing left behind that is not a dataset's."""

import json
import os
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from pipeline.dataset import folder as run_folder
from pipeline.dataset.folder import RunFolder, Shard
from pipeline.dataset.layout import ViewPaths
from pipeline.errors import InputError, RunError

WHOLE = Shard()
IDENTITY = {"format": "1", "count": 3, "options": {"seed": 0, "scale": 1.0}, "inputs_sha256": {"frame": "ab"}}


def tree(folder: Path) -> dict[str, tuple[bytes, int]]:
    """Content and time of change of all files."""
    return {
        path.relative_to(folder).as_posix(): (path.read_bytes(), path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def write_record(folder: Path, index: int) -> Path:
    path = ViewPaths(folder, index).file("frame")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("{}")
    return path


def test_a_finished_folder_holds_the_record_alone(tmp_path):
    out = tmp_path / "deep" / "out"
    with RunFolder(out, IDENTITY, WHOLE) as folder:
        (out / ".partial-1").write_text("half")
        (out / "train_synt").mkdir()
        (out / "train_synt" / ".partial-2").write_text("half")
        folder.finish()
    assert sorted(tree(out)) == ["dataset.json"]
    assert not (out / ".work").exists()
    assert json.loads((out / "dataset.json").read_text()) == IDENTITY


def test_a_stopped_run_is_resumed_and_its_leftovers_removed(tmp_path):
    with RunFolder(tmp_path, IDENTITY, WHOLE):
        record = write_record(tmp_path, 0)
        (tmp_path / ".partial-1").write_text("half")
    with RunFolder(tmp_path, IDENTITY, WHOLE):
        assert record.exists()
        assert not (tmp_path / ".partial-1").exists()


@pytest.mark.parametrize(("one", "other"), [(WHOLE, WHOLE), (WHOLE, Shard(0, 2)), (Shard(1, 2), Shard(1, 2))], ids=str)
def test_two_runs_of_the_same_views_are_kept_apart(tmp_path, one, other):
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
def test_shards_share_a_folder_and_the_last_one_tidies_up(tmp_path, monkeypatch):
    monkeypatch.setattr(run_folder, "LAST_SHARDS_SECONDS", 0.2)
    with ExitStack() as stack:
        first, second, third = (stack.enter_context(RunFolder(tmp_path, IDENTITY, Shard(i, 3))) for i in range(3))
        live = tmp_path / ".partial-of-another"
        live.write_text("half")
        first.finish()
        second.finish()
        # the third one may be at work still
        assert live.exists()
        assert (tmp_path / ".work").exists()
        third.finish()
        assert sorted(tree(tmp_path)) == ["dataset.json"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows removes no open files")
def test_a_lock_on_a_removed_file_is_none(tmp_path, monkeypatch):
    """A run that waits for the lock just as the dataset is finished must not take the dead file for the folder's."""
    lock = run_folder._lock

    def lock_after_removal(descriptor: int, *, shared: bool) -> None:
        (tmp_path / ".work" / "lock").unlink()
        lock(descriptor, shared=shared)

    monkeypatch.setattr(run_folder, "_lock", lock_after_removal)
    with pytest.raises(RunError, match="another process"):
        RunFolder(tmp_path, IDENTITY, WHOLE)


CHANGES = {
    "count": ({"count": 4}, "count was 3, is 4"),
    "seed": ({"options": {"seed": 1, "scale": 1.0}}, "options.seed was 0, is 1"),
    "a new option": ({"options": {"seed": 0, "scale": 1.0, "blur": True}}, "options.blur was null, is true"),
    "frame": ({"inputs_sha256": {"frame": "cd"}}, "the file of the frame has changed"),
    "all": ({"count": 1, "format": "2", "a": 1, "b": 2, "c": 3}, r"\(a was null, is 1; .* and 1 more\)"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_another_runs_dataset_is_not_touched(tmp_path, change):
    values, message = CHANGES[change]
    with RunFolder(tmp_path, IDENTITY, WHOLE) as folder:
        write_record(tmp_path, 0)
        (tmp_path / ".partial-1").write_text("half")
        folder.finish()
    (tmp_path / ".partial-2").write_text("half")
    before = tree(tmp_path)
    with pytest.raises(RunError, match=f"holds the dataset of another run .*{message}.*; undo the change to resume it"):
        RunFolder(tmp_path, IDENTITY | values, WHOLE)
    assert tree(tmp_path) == before
    assert not (tmp_path / ".work").exists()


def test_foreign_folders_are_not_touched(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(RunError, match="expected a new or empty folder or a dataset to resume, found other files"):
        RunFolder(tmp_path, IDENTITY, WHOLE)
    assert sorted(tree(tmp_path)) == ["thesis.tex"]


def test_a_damaged_record_is_reported(tmp_path):
    (tmp_path / "dataset.json").write_text("{")
    with pytest.raises(RunError, match=r"dataset\.json: expected the record of a dataset, found no JSON"):
        RunFolder(tmp_path, IDENTITY, WHOLE)


def test_a_file_in_place_of_a_folder_is_reported(tmp_path):
    (tmp_path / "file").write_text("x")
    for path in (tmp_path / "file", tmp_path / "file" / "out"):
        with pytest.raises(RunError, match=r": cannot write to the folder \(.+\)"):
            RunFolder(path, IDENTITY, WHOLE)


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs Linux's /proc, where nobody can create folders")
def test_an_unwritable_place_is_reported():
    with pytest.raises(RunError, match=r"/proc/out: cannot write to the folder \(No such file or directory\)"):
        RunFolder(Path("/proc/out"), IDENTITY, WHOLE)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_protected_folder_is_reported(tmp_path):
    for mode in (0o555, 0o000):
        out = tmp_path / f"{mode:o}"
        out.mkdir()
        out.chmod(mode)
        with pytest.raises(RunError, match=r"cannot write to the folder \(Permission denied\)"):
            RunFolder(out, IDENTITY, WHOLE)
        with pytest.raises(RunError, match=r"cannot write to the folder \(Permission denied\)"):
            RunFolder(out / "new", IDENTITY, WHOLE)
        out.chmod(0o755)


@pytest.mark.parametrize("existing", ["", "deep", "deep/out"])
def test_unusable_input_leaves_nothing_behind(tmp_path, existing):
    (tmp_path / existing).mkdir(parents=True, exist_ok=True)
    out = tmp_path / "deep" / "out"

    def stopped() -> None:
        with RunFolder(out, IDENTITY, WHOLE):
            (out / "camera.json").write_text("{}")
            (out / "models").mkdir()
            raise InputError("bad")

    with pytest.raises(InputError, match="bad"):
        stopped()
    assert (tmp_path / existing).is_dir()
    assert sorted(tmp_path.rglob("*")) == sorted(
        tmp_path / part for part in ("deep", "deep/out") if existing.startswith(part)
    )


@pytest.mark.parametrize("error", [InputError("bad"), RunError("full"), KeyboardInterrupt()], ids=repr)
def test_finished_views_stay_whatever_happens(tmp_path, error):
    def stopped(error: BaseException) -> None:
        with RunFolder(tmp_path, IDENTITY, WHOLE):
            write_record(tmp_path, 1)
            raise error

    with pytest.raises(type(error)):
        stopped(error)
    assert ViewPaths(tmp_path, 1).file("frame").exists()
    with pytest.raises(InputError):
        stopped(InputError("bad"))
    assert ViewPaths(tmp_path, 1).file("frame").exists()


def test_a_resumed_folder_stays_even_without_views(tmp_path):
    with RunFolder(tmp_path, IDENTITY, WHOLE):
        pass
    with pytest.raises(InputError), RunFolder(tmp_path, IDENTITY, WHOLE):
        raise InputError("bad")
    assert (tmp_path / "dataset.json").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no shared locks")
def test_unusable_input_leaves_another_shards_work_alone(tmp_path):
    with RunFolder(tmp_path, IDENTITY, Shard(0, 2)):
        (tmp_path / "dataset.json").unlink()  # as if both had started in the same instant
        with pytest.raises(InputError), RunFolder(tmp_path, IDENTITY, Shard(1, 2)):
            raise InputError("bad")
        assert (tmp_path / "dataset.json").exists()
        assert (tmp_path / ".work").exists()
