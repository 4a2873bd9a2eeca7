"""Numbers in sentences."""


def two_digits(value: float) -> str:
    """Two significant digits, without an exponent for large numbers: 0.034, 1.2, 120."""
    return f"{value:.2g}" if abs(value) < 99.5 else f"{value:.0f}"
