"""Archives: another library reads what is written, the places are those of the contents, and damage is found."""

import io
import tarfile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.packing.tar import member_places, write_end, write_member

NAMES = st.text("abcdefghijklmnopqrstuvwxyz0123456789_.", min_size=1, max_size=60)
MEMBERS = st.dictionaries(NAMES, st.binary(max_size=1500), max_size=6)


def archive(members: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    for name, data in members.items():
        write_member(stream, name, data)
    write_end(stream)
    return stream.getvalue()


def places(data: bytes) -> dict[str, tuple[int, int]]:
    return member_places(lambda offset, size: data[offset : offset + size], "a.tar")


@given(members=MEMBERS)
def test_members_are_where_they_are_said_to_be(members):
    data = archive(members)
    assert {name: data[first : first + size] for name, (first, size) in places(data).items()} == members
    with tarfile.open(fileobj=io.BytesIO(data)) as found:
        entries = found.getmembers()
        assert {entry.name: found.extractfile(entry).read() for entry in entries} == members
        assert {(entry.mtime, entry.uid, entry.gid, entry.uname, entry.mode) for entry in entries} <= {
            (0, 0, 0, "", 0o644)
        }
    assert len(data) % tarfile.RECORDSIZE == 0


@settings(max_examples=60)
@given(members=MEMBERS.filter(bool), data=st.data())
def test_a_cut_or_changed_header_is_found(members, data):
    whole = archive(members)
    end = sum(512 + len(content) + -len(content) % 512 for content in members.values())
    cut = data.draw(st.integers(0, end))
    with pytest.raises(InputError, match=r"a\.tar: expected a whole shard|found a damaged one"):
        places(whole[:cut])
    harmed = bytearray(whole)
    harmed[data.draw(st.integers(0, 256))] ^= 1 << data.draw(st.integers(0, 6))
    with pytest.raises(InputError, match=r"a\.tar: expected"):
        places(bytes(harmed))


@pytest.mark.parametrize("form", [tarfile.PAX_FORMAT, tarfile.GNU_FORMAT])
def test_archives_of_others_are_refused(form):
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w", format=form) as made:
        for name in ("a" * 200, "b"):
            made.addfile(tarfile.TarInfo(name))
    with pytest.raises(InputError, match="expected a shard as oneframe pack writes it"):
        places(stream.getvalue())
