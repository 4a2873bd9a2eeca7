"""How code values stand for linear light."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Transfer:
    """How code values c stand for linear light: ((c + shift) / (1 + shift))^gamma; near black c / slope.

    Attributes
    ----------
    shift, gamma
        Of the power.
    straight, slope
        Code value up to which the curve is straight, and its slope there, codes to light.
    """

    shift: float
    gamma: float
    straight: float
    slope: float


SRGB = Transfer(0.055, 2.4, 0.04045, 12.92)
TRANSFERS = {"srgb": SRGB, "bt709": Transfer(0.099, 1 / 0.45, 0.081, 4.5), "linear": Transfer(0.0, 1.0, 0.0, 1.0)}
"""By name: IEC 61966-2-1, the curve of video (ITU-R BT.709), and none."""
