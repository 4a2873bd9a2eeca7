"""Instruments of ear surgery as triangle meshes: tubes around paths, a few random sizes each, in mm.

The tip is in the origin, and the shaft runs along +z, as long as asked for. Paths lie in the plane of x and z, and
bends lead the tip towards +x: held with +x away from the camera, the tip points down. Sizes are usual ones: burrs of 2
to 6 mm on shafts of 2.4 mm, suction tubes of 1.5 to 4 mm, retractor blades 10 mm wide, fingers 15 mm thick.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..surface.mesh import TriangleMesh

STEP_MM, LONGEST_MM = 5.0, 2000.0
"""Steps of the lengths that an instrument may have, and the most."""

SIDES = 32
"""Corners of a tube's cross-section."""


@dataclass(frozen=True)
class Finish:
    """How a part looks: code values 0..1 where the light counts 1; strength and sharpness of its shine."""

    rgb: tuple[float, float, float]
    gloss: float = 0.0
    sharpness: float = 1.0


BORE = Finish((0.02, 0.02, 0.02))


@dataclass(frozen=True)
class Tube:
    """A closed tube around a path.

    Attributes
    ----------
    path
        ``(N, 2)`` x and z, mm, from the tip on.
    half_widths
        ``(N, 2)`` mm, within the plane of the path and across it.
    finish
        How it looks.
    endless
        Whether its last point moves along +z, as far as the instrument is to reach.
    is_flat
        Whether its cross-section is a rounded rectangle instead of an ellipse.
    """

    path: np.ndarray
    half_widths: np.ndarray
    finish: Finish
    endless: bool = False
    is_flat: bool = False

    @property
    def ends(self) -> tuple[np.ndarray, float]:
        """``(N, 3)`` where its last point may be, from the nearest on, and how wide it is there at most, mm."""
        z = np.arange(self.path[-2, 1] + STEP_MM, LONGEST_MM, STEP_MM)
        return np.stack([np.full(len(z), self.path[-1, 0]), 0 * z, z], axis=1), float(self.half_widths.max())

    def reaching(self, length_mm: float) -> "Tube":
        """The tube of an instrument of this length."""
        if not self.endless:
            return self
        path = self.path.copy()
        path[-1, 1] = max(length_mm, path[-2, 1] + 1)
        return replace(self, path=path)

    @property
    def mesh(self) -> TriangleMesh:
        """Its surface."""
        along = np.gradient(self.path, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        angle = np.arange(SIDES) * 2 * np.pi / SIDES
        # a superellipse of the fourth power is a rectangle with round corners
        x, y = (np.sign(at) * np.abs(at) ** (0.5 if self.is_flat else 1.0) for at in (np.cos(angle), np.sin(angle)))
        within, across = self.half_widths[:, :1] * x, self.half_widths[:, 1:] * y
        rings = np.stack(
            [self.path[:, :1] + within * along[:, 1:], across, self.path[:, 1:] - within * along[:, :1]], axis=-1
        )
        ends = np.insert(self.path[[0, -1]], 1, 0.0, axis=1)
        ring, corner = np.mgrid[: len(rings) - 1, :SIDES]
        first, beside = ring * SIDES + corner, ring * SIDES + (corner + 1) % SIDES
        above, both = first + SIDES, beside + SIDES
        low, high = len(rings) * SIDES, len(rings) * SIDES + 1
        faces = [(first, beside, both), (first, both, above)]
        faces += [(np.full(SIDES, low), beside[0], first[0]), (np.full(SIDES, high), above[-1], both[-1])]
        corners = np.concatenate([np.stack(each, axis=-1).reshape(-1, 3) for each in faces])
        return TriangleMesh(np.concatenate([rings.reshape(-1, 3), ends]), corners.astype(np.int32))


@dataclass(frozen=True)
class Instrument:
    """An instrument and how it is held.

    Attributes
    ----------
    tubes
        Its parts, the endless one last.
    tilt_deg
        Limits of the angle between its shaft and the view's axis.
    from_side
        Whether it comes from the border on whose side its tip is, as what keeps the wound open; what works in it comes
        from anywhere.
    """

    tubes: tuple[Tube, ...]
    tilt_deg: tuple[float, float] = (20.0, 60.0)
    from_side: bool = False

    def parts(self, length_mm: float) -> list[tuple[TriangleMesh, Finish]]:
        """The meshes of the instrument, this long, and how they look."""
        return [(tube.reaching(length_mm).mesh, tube.finish) for tube in self.tubes]


def burr(rng: np.random.Generator) -> Instrument:
    """A round cutting or diamond burr on its shaft, in the sleeve of a handpiece."""
    ball, shaft, neck = rng.uniform(1.0, 3.0), 1.2, rng.uniform(0.5, 0.8)
    sleeve, begins = rng.uniform(2.5, 4.0), rng.uniform(18.0, 40.0)
    head = Finish((0.42, 0.36, 0.25), 0.25, 8.0) if rng.random() < 0.5 else _steel(rng, 0.35)
    angles = np.linspace(0.05, np.pi - np.arcsin(neck / ball), 16)
    round_, end = np.stack([ball * (1 - np.cos(angles)), ball * np.sin(angles)], axis=1), 2 * ball
    held = [(begins, 0.8 * sleeve), (begins + 1, sleeve), (begins + 12, sleeve), (begins + 60, 1.3 * sleeve)]
    return Instrument(
        (
            _lathed(round_, head),
            _lathed([(end - 0.3, neck), (end + 2, neck), (end + 5, shaft), (begins + 2, shaft)], _steel(rng)),
            _lathed([*held, (begins + 61, 1.3 * sleeve)], _steel(rng, 0.2), endless=True),
        )
    )


def suction(rng: np.random.Generator) -> Instrument:
    """A bent suction tube."""
    radius = rng.uniform(0.75, 2.0)
    path = _bent(rng.uniform(20.0, 45.0), rng.uniform(5.0, 35.0), 12.0)
    tube = Tube(path, np.full((len(path), 2), radius), _steel(rng), endless=True)
    into = path[1] / np.linalg.norm(path[1])
    bore = Tube(np.array([-0.02, 0.5])[:, None] * into, np.full((2, 2), 0.75 * radius), BORE)
    return Instrument((bore, tube))


def hook(rng: np.random.Generator) -> Instrument:
    """A blunt hook of 90 degrees."""
    reach, thin, thick = rng.uniform(1.0, 2.5), rng.uniform(0.25, 0.4), rng.uniform(1.0, 1.6)
    turn = np.linspace(0, np.pi / 2, 6)
    round_ = np.stack([-reach * (0.6 + 0.4 * np.sin(turn)), 0.4 * reach * (1 - np.cos(turn))], axis=1)
    path = np.concatenate([[(0, 0), (-0.3 * reach, 0)], round_, [(-reach, 15), (-reach, 40), (-reach, 60)]])
    radius = np.array([0.6 * thin, *np.linspace(thin, 1.2 * thin, 7), 1.6 * thin, thick, thick])
    return Instrument((Tube(path, np.stack([radius] * 2, axis=1), _steel(rng), endless=True),))


def blade(rng: np.random.Generator) -> Instrument:
    """The blade of a retractor, over the rim."""
    path = _bent(rng.uniform(6.0, 15.0), rng.uniform(50.0, 80.0), 5.0)
    half_widths = np.tile([rng.uniform(0.6, 1.0), rng.uniform(4.0, 6.0)], (len(path), 1))
    half_widths[0] *= 0.6, 0.9
    return Instrument((Tube(path, half_widths, _steel(rng), endless=True, is_flat=True),), (60.0, 85.0), from_side=True)


def finger(rng: np.random.Generator) -> Instrument:
    """A gloved finger."""
    radius, tip = rng.uniform(6.5, 8.5), np.linspace(0.1, np.pi / 2, 8)
    bent = _bent(rng.uniform(20.0, 28.0), rng.uniform(15.0, 50.0), 18.0)
    into = bent[1] / np.linalg.norm(bent[1])
    # the middle of the ball is a radius from the tip
    path = np.concatenate([0.9 * radius * (1 - np.cos(tip))[:, None] * into, bent[1:]])
    width = np.concatenate([0.92 * radius * np.sin(tip), np.linspace(0.94, 1.08, len(bent) - 1) * radius])
    gloves = ((0.88, 0.84, 0.74), (0.90, 0.90, 0.88), (0.42, 0.55, 0.80), (0.45, 0.66, 0.58))
    glove = Finish(gloves[rng.integers(len(gloves))], rng.uniform(0.0, 0.25), 12.0)
    tube = Tube(path, np.stack([0.9 * width, width], axis=1), glove, endless=True)
    return Instrument((tube,), (50.0, 80.0), from_side=True)


KINDS: tuple[Callable[[np.random.Generator], Instrument], ...] = (burr, suction, hook, blade, finger)
"""What makes an instrument of random sizes, each as often as another."""


def _steel(rng: np.random.Generator, grey: float = 0.45) -> Finish:
    shade = grey * rng.uniform(0.7, 1.3)
    # tilted shafts turn no normal towards the lens: only a wide shine is seen on them
    return Finish((shade, shade, 1.02 * shade), rng.uniform(0.3, 1.2), rng.uniform(4.0, 30.0))


def _lathed(profile: Sequence[tuple[float, float]] | np.ndarray, finish: Finish, *, endless: bool = False) -> Tube:
    """A straight part with radii at places along it."""
    z, radius = np.asarray(profile, float).T
    return Tube(np.stack([0 * z, z], axis=1), np.stack([radius, radius], axis=1), finish, endless)


def _bent(straight_mm: float, bend_deg: float, radius_mm: float) -> np.ndarray:
    """A path from the tip, straight at first, then bent into +z."""
    angles = np.radians(bend_deg) * np.linspace(1, 0, 9)
    directions = np.stack([-np.sin(angles), np.cos(angles)], axis=1)
    steps = radius_mm * np.radians(bend_deg) / 8 * (directions[:-1] + directions[1:]) / 2
    bend = straight_mm * directions[0] + np.cumsum(steps, axis=0)
    on = bend[-1] + np.array([[0, 5.0], [0, 10.0]])
    return np.concatenate([[(0, 0)], straight_mm * directions[:1] * [[0.5], [1.0]], bend, on])
