"""Lengths in files: metres become millimetres, and back, by moving the decimal point, so that nothing is rounded."""

from decimal import Decimal, InvalidOperation

MM_PER_UNIT = {"mm": 1.0, "m": 1000.0}


class WrittenFloat(float):
    """A number of a text file that remembers its digits: the ``parse_float`` of :mod:`tomllib` and :mod:`json`."""

    digits: str

    def __new__(cls, digits: str) -> "WrittenFloat":
        number = super().__new__(cls, digits)
        number.digits = digits
        return number


def millimetres(value: float, mm_per_unit: float) -> float:
    """A length of a file in mm: the float next to what its digits say, where they are known."""
    if mm_per_unit == 1:
        return float(value)
    try:
        written = Decimal(value.digits if isinstance(value, WrittenFloat) else repr(float(value)))
        return float(written * Decimal(mm_per_unit))
    except InvalidOperation:  # an exponent that Decimal does not hold
        return float(value) * mm_per_unit


def length_text(value_mm: float, mm_per_unit: float) -> str:
    """The number to write for a length in mm; :func:`millimetres` reads it back to the last bit."""
    if mm_per_unit == 1:
        return repr(float(value_mm))
    shortest = repr(float(value_mm) / mm_per_unit)
    if millimetres(float(shortest), mm_per_unit) == value_mm:
        return shortest
    return str(Decimal(repr(float(value_mm))) / Decimal(mm_per_unit))
