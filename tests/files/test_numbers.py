"""Numbers in files are read exactly or refused; numbers in messages are rounded, short and plain."""

import io
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from oneframe.errors import InputError
from oneframe.files.numbers import format_two_digits, npy_array, parsed_numbers


def saved(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


@given(
    hnp.arrays(
        hnp.integer_dtypes(endianness="?") | hnp.floating_dtypes(endianness="?", sizes=(32, 64)),
        hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4),
    ),
    st.booleans(),
)
def test_arrays_come_back(array, columns_first):
    array = np.asarray(array, order="F" if columns_first else "C")
    found = npy_array(saved(array), "a.npy")
    assert (found.dtype, found.shape) == (array.dtype, array.shape)
    assert found.tobytes() == array.tobytes()


@given(st.integers(0, 200))
def test_a_cut_off_array_is_refused(size):
    whole = saved(np.arange(9.0).reshape(3, 3))
    with pytest.raises(InputError, match=r"^a\.npy: expected an array of numbers, cannot read it .*save floats"):
        npy_array(whole[: min(size, len(whole) - 1)], "a.npy")


@pytest.mark.parametrize("shape", ["(1000000000000, 4, 4)", "(-1, 4, 4)", "(-1, -4, 4)", "(2.0, 2)"])
def test_a_header_that_does_not_fit_takes_no_memory(shape):
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    data = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + bytes(256)
    with pytest.raises(InputError, match="cannot read it"):
        npy_array(data, "a.npy")


@given(st.floats(1e-4, 1e6))
def test_numbers_are_close_and_plain(value):
    text = format_two_digits(value)
    assert abs(float(text) - value) <= 0.0501 * value
    assert "e" not in text
    assert len(text.replace(".", "").lstrip("0")) <= max(2, len(f"{value:.0f}"))


@given(
    st.lists(
        st.sampled_from(list("0123456789+-.eEnaif/\0\v#") + [" "] * 9 + ["\n"] * 3 + ["12", "1.5", "-3", "7e-2"]),
        max_size=9,
    )
)
def test_numbers_are_those_of_the_words(letters):
    text = "".join(letters)
    floats = parsed_numbers(text.encode(), np.float64)
    integers = parsed_numbers(text.encode(), np.int64)
    if all(re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", word) for word in text.split()):
        assert floats.tolist() == [float(word) for word in text.split()]
    elif floats is not None:  # nan or inf
        assert np.array_equal(floats, [float(word) for word in text.split()], equal_nan=True)
    if all(re.fullmatch(r"[+-]?\d+", word) for word in text.split()):
        assert integers.tolist() == [int(word) for word in text.split()]
    else:
        assert integers is None
