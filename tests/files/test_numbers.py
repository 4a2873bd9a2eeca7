"""Numbers in sentences are close, short and plain."""

from hypothesis import given
from hypothesis import strategies as st

from pipeline.files.numbers import format_two_digits


@given(st.floats(1e-4, 1e6))
def test_numbers_are_close_and_plain(value):
    text = format_two_digits(value)
    assert abs(float(text) - value) <= 0.0501 * value
    assert "e" not in text
    assert len(text.replace(".", "").lstrip("0")) <= max(2, len(f"{value:.0f}"))
