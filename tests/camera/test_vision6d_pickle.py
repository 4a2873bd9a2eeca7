"""Pickles run no code, and end soon: with the numbers that are in them, or with a sentence."""

import pickle
import pickletools
import time
import tracemalloc
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.camera.vision6d_pickle import camera_table
from pipeline.errors import InputError

SECONDS, MEGABYTES = 1.0, 32
K = np.array([[9000.0, 0.0, 970.25], [0.0, 9010.0, 530.5], [0.0, 0.0, 1.0]])
PROTOCOLS = range(pickle.HIGHEST_PROTOCOL + 1)


class Call:
    """Unpickled, it calls."""

    def __init__(self, function, *arguments) -> None:
        self.call = function, arguments

    def __reduce__(self):
        return self.call


FROM_BUFFER = np.zeros(1).__reduce_ex__(5)[0]
SCALAR = np.float64().__reduce__()[0]


def array(code: object, shape: tuple[int, ...], data: bytes) -> bytes:
    """An array, with whatever is given as the code of its type."""
    return pickle.dumps({"K": Call(FROM_BUFFER, data, Call(np.dtype, code), shape, "C")}, 4)


def as_key(key: bytes) -> bytes:
    """A dictionary with the outcome of a program as its key."""
    return b"\x80\x04}" + key + b"K\x01s."


def doubled(first: bytes, recall: bytes, remember: bytes, levels: Iterable[int]) -> bytes:
    """A tuple that holds itself twice, 60 levels deep: to hash it takes 2^60 steps."""
    return as_key(first + remember + b"".join(recall % level + b"\x86" + remember for level in levels))


def shared_lists() -> list:
    nested: list = [1.0]
    for _ in range(60):
        nested = [nested, nested]
    return nested


FRAME = b"\x95" + bytes(8)
TUPLE, LEVELS = b"K\x01\x85", range(60)
BOMBS = {
    "tuples by DUP": as_key(TUPLE + b"2\x86" * 60),
    "tuples by MEMOIZE": doubled(TUPLE, b"h%c", b"\x94", LEVELS),
    "tuples by PUT": doubled(TUPLE, b"h%c", b"q\x00", [0] * 60),
    "tuples remembered after a frame": doubled(TUPLE, b"h%c", FRAME + b"\x94", LEVELS),
    "tuples remembered after a state": doubled(TUPLE, b"h%c", b"Nb\x94", LEVELS),
    "tuples remembered after no items": doubled(TUPLE, b"h%c", b"(e\x94", LEVELS),
    "tuples after one number many times": doubled(b"(" + b"U\x01aq\x00" * 60 + b"t", b"h%c", b"\x94", range(1, 61)),
    "lists as K": pickle.dumps({"K": shared_lists()}),
    "lists as the type of an array": array(shared_lists(), (1,), bytes(8)),
    "rows without numbers": array("f8", (10**9, 0), b""),
    "an array larger than its data": array("f8", (10**9,), bytes(8)),
    "an array of a large type": array("V2147483647", (), b""),
    "a scalar of a large type": pickle.dumps({"K": Call(SCALAR, Call(np.dtype, "V2147483647"), b"")}),
    "an array without data": pickle.dumps({"K": Call(np.ndarray, (10**5, 10**5))}),
    "40 000 tuples": as_key(b")" + b"\x85" * 40_000),
    "900 000 tuples": as_key(b")" + b"\x85" * 900_000),
    "40 000 lists": b"\x80\x04" + b"]" * 40_000 + b"a" * 39_999 + b".",
    "40 000 dictionaries": b"\x80\x04" + b"}K\x01" * 40_000 + b"N" + b"s" * 40_000 + b".",
    "40 000 marks": b"\x80\x04" + b"(" * 40_000,
    "a number cut off": b"\x80\x04\x8a\xff",
    "a large number cut off": b"\x80\x04\x8b\xff\xff\xff\x7f",
    "a text cut off": b"\x80\x04\x8d" + (1 << 40).to_bytes(8, "little"),
    "bytes cut off": b"\x80\x04\x8e" + (1 << 40).to_bytes(8, "little"),
    "a byte array cut off": b"\x80\x05\x96" + (1 << 40).to_bytes(8, "little"),
    "a frame cut off": b"\x80\x04\x95" + (1 << 62).to_bytes(8, "little"),
    "decimals": b"I" + b"9" * 1_000_000 + b"\n.",
    "decimals of a long number": b"L" + b"9" * 1_000_000 + b"L\n.",
    "a far place": b"\x80\x02}r\xff\xff\xff\xff.",
    "a far place in text": b"}p9999999999\n.",
}
FUNCTION = b"\x80\x04cnumpy.core.numeric\n_frombuffer\n"
ATTACKS = {
    "a class by its name": b"(S'true'\nios\nsystem\n.",
    "a class on the stack": b"(cos\nsystem\nS'true'\no.",
    "a new object": b"\x80\x02cnumpy\nndarray\n)\x81.",
    "a new object with names": b"\x80\x04cnumpy\nndarray\n)}\x92.",
    "an extension": b"\x80\x02\x82\x01.",
    "a persistent id": b"Pid\n.",
    "a persistent object": b"\x80\x02K\x01Q.",
    "a buffer outside": b"\x80\x05\x97.",
    "a set": b"\x80\x04\x8f.",
    "a function's code": FUNCTION + b"N}U\x08__code__K\x01s\x86b.",
    "a function's attribute": FUNCTION + b"}U\x01aK\x01sb.",
    "another codec": b"\x80\x04c_codecs\nencode\nU\x01aU\x05rot13\x86R.",
    "a dotted name": b"\x80\x04U\x05numpyU\x0bf2py.system\x93.",
    "a part of a name": b"\x80\x04U\x05numpyU\x10ndarray.__init__\x93.",
    "negative shape": array("f8", (-1,), bytes(8)),
    **{
        f"{name}, protocol {protocol}": pickle.dumps({"K": content}, protocol)
        for protocol in PROTOCOLS
        for name, content in {
            "eval": Call(eval, "1"),
            "nested": Call(getattr, Call(eval, "1"), "real"),
            "np.load": Call(np.load, "x.npy"),
            "objects": np.array([[1, "a"]], object),
            "fields": np.zeros(2, "f8,i4"),
        }.items()
    },
}


@pytest.mark.parametrize("name", [*BOMBS, *ATTACKS])
def test_a_hostile_pickle_ends_soon_with_a_sentence(name):
    data = (BOMBS | ATTACKS)[name]
    tracemalloc.start()
    start = time.perf_counter()
    try:
        with pytest.raises(InputError, match=r"^camera\.pkl: expected "):
            camera_table(data, "camera.pkl")
        assert time.perf_counter() - start < SECONDS
        assert tracemalloc.get_traced_memory()[1] < MEGABYTES * 1e6
    finally:
        tracemalloc.stop()


def test_the_reader_is_whole_after_all_attacks():
    for data in (BOMBS | ATTACKS).values():
        with pytest.raises(InputError):
            camera_table(data, "camera.pkl")
    table = {"camera_intrinsics": K.tolist(), "canvas_height": 1080}
    assert camera_table(pickle.dumps(table | {"camera_intrinsics": K}), "camera.pkl") == table


def test_an_array_that_is_named_often_is_kept_once():
    data = pickle.dumps({"camera_intrinsics": [np.zeros(100_000)] * 600})
    tracemalloc.start()
    try:
        found = camera_table(data, "camera.pkl")["camera_intrinsics"]
        assert tracemalloc.get_traced_memory()[1] < MEGABYTES * 1e6
    finally:
        tracemalloc.stop()
    assert len(found) == 600
    assert found[-1] == [0.0] * 100_000


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize(
    "k", [K, K.tolist(), tuple(map(tuple, K.tolist())), np.asfortranarray(K), K.astype(">f4"), K.astype("i2")],
    ids=["array", "lists", "tuples", "by columns", "big endian", "integers"],
)  # fmt: skip
def test_numbers_come_back_to_the_last_bit(k, protocol):
    table = {"camera_intrinsics": k, "canvas_height": np.int64(1080), "scale": np.float32(0.1), "name": "left"}
    written = pickle.dumps(table, protocol)
    for data in (written, pickletools.optimize(written)):
        found = camera_table(data, "camera.pkl")
        assert found["camera_intrinsics"] == np.array(k).tolist()
        assert (found["canvas_height"], found["scale"], found["name"]) == (1080, float(np.float32(0.1)), "left")


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_file_that_is_cut_off_anywhere_is_refused(protocol):
    data = pickle.dumps({"camera_intrinsics": K, "canvas_height": np.int64(1080)}, protocol)
    for length in range(len(data)):
        with pytest.raises(InputError):
            camera_table(data[:length], "camera.pkl")


def test_a_number_that_no_camera_has_is_no_number():
    assert camera_table(pickle.dumps({"canvas_width": 10**10_000}), "camera.pkl") == {"canvas_width": "a int"}


PIECES = [
    *(opcode.code.encode("latin-1") for opcode in pickletools.opcodes if opcode.arg is None),
    *(b"K\x01", b"K\x02", b"h\x00", b"h\x01", b"q\x00", b"q\x01", b"C\x08" + bytes(8), b"U\x02f8", b"U\x01C"),
    *(b"cnumpy\nndarray\n", b"cnumpy\ndtype\n", b"cnumpy.core.multiarray\n_reconstruct\n"),
    *(b"cnumpy.core.numeric\n_frombuffer\n", b"cnumpy._core.multiarray\nscalar\n"),
    *(b"c_codecs\nencode\n", b"cos\nsystem\n"),
]


@settings(max_examples=400)
@given(pieces=st.lists(st.sampled_from(PIECES), max_size=60))
def test_any_program_gives_a_table_or_a_sentence(pieces):
    start = time.perf_counter()
    try:
        outcome = str(type(camera_table(b"\x80\x05}" + b"".join(pieces) + b".", "camera.pkl")))
    except InputError as error:
        outcome = str(error)
    assert outcome == "<class 'dict'>" or outcome.startswith("camera.pkl: expected ")
    assert time.perf_counter() - start < SECONDS
