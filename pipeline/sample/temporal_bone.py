"""The built-in sample case: a drilled left temporal bone as a mesh, made from formulas, in millimetres.

It replaces the surface that a segmented CT gives after a mastoidectomy: the lateral skull with the ear canal, a cavity
drilled behind it with burrs (scallops, undercut walls, opened air cells), the posterior canal wall left as a bridge,
and below it the antrum, the lateral semicircular canal and the ossicles. Needs ``skimage``, through
:mod:`oneframe.sample.distance_field`.

The bone is a signed distance field on a regular grid, positive in bone and negative in air; drilling takes the minimum
with the distance to a burr. The anatomy is described in the frame ``local``: x posterior, y superior, z lateral, origin
on the cortex over the antrum. Results are in ``mesh``, with the LPS axes of a CT scanner (x left, y posterior, z
superior).
"""

from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..surface.mesh import TriangleMesh
from ..transforms import inverse_rigid, rigid, rotation_from_vector, transform_points
from .distance_field import ImplicitGrid, ball, largest_component, polyline, smooth_minimum, subtract_burrs, tube

SPACING_MM = 0.3
LOWER_MM, UPPER_MM = np.array([-42.0, -31.0, -26.0]), np.array([36.0, 29.9, 3.7])

# A head slightly rotated in the scanner: a cyclic permutation of the axes (z lateral -> x left), then a small rotation.
MESH_FROM_LOCAL = rigid(
    rotation_from_vector(np.radians([4.0, -7.0, 5.0])) @ np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    np.array([61.3, -147.8, 1042.6]),
)

FACIAL_NERVE = np.transpose(
    [
        [-15.5, -12, -8.4, -6.9, -6, -5, -4.2, -4],
        [5, 3.6, 1.6, -1.5, -7, -12, -18, -24],
        [-22.5, -21.6, -20, -18.8, -17, -15.4, -13.6, -12],
    ]
)
CHORDA_TYMPANI = np.transpose(
    [
        [-5.4, -7, -8.6, -10, -12, -15, -18],
        [-10, -6.5, -2.8, 0.8, 3, 3.4, 1.5],
        [-16.1, -16.4, -17, -17.3, -17.2, -17.6, -18.5],
    ]
)
CANAL = np.array([[-15.8, -0.6, 4.0], [-13.6, 0.0, -18.5]])
SIGMOID_SINUS = np.array([[11.5, -18.0, -11.0], [15.5, -2.0, -9.5], [17.5, 10.0, -12.5]])

MICROSCOPE = PinholeCamera(960, 720, fx=5204.6, fy=5217.9, cx=489.3, cy=351.7)
"""Intrinsics of the sample's photographs; 0.058 mm per pixel at 300 mm."""


@dataclass(frozen=True)
class SampleSurface:
    """The meshes of the sample case in the frame ``mesh``, mm.

    Attributes
    ----------
    bone
        One open sheet, front faces towards the air.
    structures
        Closed meshes by name: ``facial_nerve``, ``chorda_tympani``, ``ossicles``.
    tissue
        ``(V,)`` weights, 0..1, per vertex of ``bone`` for what a photograph shows there: ``drilled`` (below the
        cortex), ``air_cell``, ``mucosa`` (antrum, middle ear), ``canal_skin``, ``pool`` (fluid collects), ``nerve``
        (thin bone over the facial nerve), ``soft_tissue`` (left on the cortex around the field).
    """

    bone: TriangleMesh
    structures: dict[str, TriangleMesh]
    tissue: dict[str, np.ndarray]


def sample_surface(rng: np.random.Generator | None = None, *, spacing_mm: float = SPACING_MM) -> SampleSurface:
    """Generate the sample case.

    Parameters
    ----------
    rng
        Draws burr strokes, air cells and bone texture; ``None`` always gives the same built-in case.
    spacing_mm
        Grid spacing; the number of triangles is proportional to its inverse square (about 200 000 at 0.3 mm).
    """
    rng = np.random.default_rng(2024) if rng is None else rng
    grid = ImplicitGrid(LOWER_MM, UPPER_MM, spacing_mm)
    cell_depth = _drill(grid, rng)
    _open_middle_ear(grid)
    ossicles = ImplicitGrid(np.array([-15.5, -4.5, -22.0]), np.array([-5.0, 9.0, -12.0]), 0.14, solid=False)
    ossicles.fill(_ossicles)
    # the sheet's ossicles lie 0.12 mm inside the structure of that name, so that the two never coincide
    grid.fill(lambda x, y, z: _ossicles(x, y, z) + 0.12, ossicles.lower, ossicles.upper, blend=0.25)
    _roughen(grid, rng)

    bone_local = largest_component(*grid.surface())
    structures = {
        "facial_nerve": tube(FACIAL_NERVE, 0.9),
        "chorda_tympani": tube(CHORDA_TYMPANI, 0.28),
        "ossicles": largest_component(*ossicles.surface()),
    }
    return SampleSurface(
        bone=_in_mesh_frame(bone_local),
        structures={name: _in_mesh_frame(mesh) for name, mesh in structures.items()},
        tissue=_tissue(bone_local.vertices, grid.at(cell_depth, bone_local.vertices)),
    )


def microscope_pose(tilt_deg: float, azimuth_deg: float, roll_deg: float, distance_mm: float) -> np.ndarray:
    """``cam_from_mesh`` of a microscope over the cavity.

    Parameters
    ----------
    tilt_deg, azimuth_deg
        How far the microscope leans from lateral, and in which direction: 0 posterior, 90 superior, 180 anterior, 270
        inferior.
    roll_deg
        Rotation about the optical axis; at 0 superior is up in the image.
    distance_mm
        From the centre of projection to the centre of the cavity's opening.
    """
    tilt, azimuth, roll = np.radians([tilt_deg, azimuth_deg, roll_deg])
    backward = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    right = np.cross([0.0, 1.0, 0.0], backward)
    right /= np.linalg.norm(right)
    level = np.stack([right, np.cross(right, backward), -backward])
    rotation = rotation_from_vector(np.array([0.0, 0.0, roll])) @ level
    mouth = np.array([-2.5, 0.0, -4.0])
    return rigid(rotation, -rotation @ (mouth + distance_mm * backward)) @ inverse_rigid(MESH_FROM_LOCAL)


def frame_pose() -> np.ndarray:
    """``cam_from_mesh`` of the sample's frame: from inferior and posterior into the antrum."""
    return microscope_pose(20, 328, 4, 300)


def held_out_poses() -> list[np.ndarray]:
    """``cam_from_mesh`` of held-out photographs, viewing directions 12° to 20° from the frame's."""
    views = (6, 300, -6, 292), (27, 358, 8, 284), (23, 285, 14, 304), (16, 33, -8, 308)
    return [microscope_pose(*view) for view in views]


# --- anatomy in the frame local --------------------------------------------------------------------------------------


def _cortex_height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """z of the lateral skull: a flat dome with the zygomatic root, temporal line, mastoid tip and suprameatal spine."""

    def bump(height: float, at_x: float, at_y: float | np.ndarray, width_x: float, width_y: float) -> np.ndarray:
        return height * np.exp(-(((x - at_x) / width_x) ** 2) - ((y - at_y) / width_y) ** 2)

    z = 0.4 - x * x / 230 - y * y / 190
    z = z + bump(3.2, -36, 8.5, 14, 4.2) + bump(1.1, -8, 14.5 + 0.1 * x, 20, 3.0) + bump(2.2, 3, -22, 9, 7)
    z = z + bump(1.3, -10.8, 4.8, 1.6, 1.3) - bump(1.2, -27, -8, 7, 6)
    return z + 0.22 * np.sin(0.45 * x + 0.8) * np.sin(0.38 * y + 0.3) + 0.12 * np.sin(0.9 * x - 0.7 * y)


def _cavity(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The drilled cavity without individual burr strokes, negative in air.

    Its section is star-shaped about an axis that leans towards the antrum, and wider below the rim towards the
    sinodural angle and the tip.
    """
    depth = np.maximum(-z, 0)
    dx, dy = x - (2.0 - 0.36 * depth), y - (-0.5 + 0.27 * depth)
    angle = np.arctan2(dy, dx)
    stations = np.radians([-180, -140, -105, -70, -35, 0, 32, 62, 95, 125, 150, 180])
    reach = np.interp(angle, stations, [10.5, 11, 12, 11, 10.5, 11.5, 16, 12, 10, 12, 13.5, 10.5])
    below_rim = np.radians([-180, -125, -95, -65, 5, 35, 75, 100, 180])
    undercut = np.interp(angle, below_rim, [0, 0.3, 3, 0.5, 0.6, 3, 2, 0, 0])
    taper = np.interp(depth, [0, 5, 9, 13, 16, 18.5, 21], [1.0, 0.97, 0.84, 0.62, 0.46, 0.34, 0.1])
    radius = reach * taper + undercut * np.exp(-(((depth - 5.5) / 2.8) ** 2))
    wall = 0.9 * (np.hypot(dx, dy) - radius.astype(np.float32))
    floor = depth - (18.2 - 0.05 * np.maximum(x + 4, 0) ** 1.5)
    return -smooth_minimum(-wall, -floor, 2.5)


def _kept(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """What the surgeon preserves, positive inside: canal wall, sinus plate, facial ridge, semicircular canal."""
    canal_wall = 5.5 - polyline(x, y, z, CANAL)
    sinus = 5.2 - polyline(x, y, z, SIGMOID_SINUS)
    ridge = 2.3 - polyline(x, y, z, FACIAL_NERVE)
    dome = -ball(x, y, z, (-4.0, 2.4, -18.8), (3.4, 2.2, 2.9))
    return np.maximum(np.maximum(canal_wall, sinus), np.maximum(ridge, dome))


def _base_cavity(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    return -smooth_minimum(-_cavity(x, y, z), -_kept(x, y, z), 1.2)


def _ossicles(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Incus (body, short process in its fossa, long process) and malleus (head, neck, handle), negative inside."""
    incus = ball(x, y, z, (-10.2, 6.0, -15.4), (1.5, 1.3, 1.6))
    short = polyline(x, y, z, np.array([[-9.8, 6.0, -15.5], [-5.8, 4.6, -17.3]]), [0.95, 0.4])
    long = polyline(x, y, z, np.array([[-10.3, 5.4, -15.8], [-9.9, 2.8, -18.5], [-10.3, 1.2, -20.2]]), [0.85, 0.5, 0.4])
    head = ball(x, y, z, (-12.4, 6.2, -15.0), (1.35, 1.25, 1.5))
    handle = polyline(
        x, y, z, np.array([[-12.5, 5.4, -15.4], [-12.8, 3, -17.6], [-13.2, -2.2, -19.2]]), [0.8, 0.5, 0.35]
    )
    incus = smooth_minimum(smooth_minimum(incus, short, 0.8), long, 0.8)
    return smooth_minimum(incus, smooth_minimum(head, handle, 0.8), 0.3)


def _drill(grid: ImplicitGrid, rng: np.random.Generator) -> np.ndarray:
    """Cortex, cavity with burr strokes, air cells; returns ``(X, Y, Z)`` depths of the grid points in a cell, mm."""
    x, y, z = np.ix_(*grid.axes)
    grid.values = _cortex_height(x, y) - z
    lower, upper = np.array([-21.0, -18.0, -24.0]), np.array([24.0, 16.0, 3.7])
    cavity, cells = (ImplicitGrid(grid.lower, grid.upper, grid.spacing) for _ in range(2))
    box, coordinates = cavity.box(lower, upper)
    kept = _kept(*coordinates)
    cavity.values[box] = -smooth_minimum(-_cavity(*coordinates), -kept, 1.2)

    wall, normal = _on_wall(rng.uniform(lower, [20, 14, 0], (450, 3)))
    # a stroke roughly follows the wall around the cavity's axis
    tangent = np.cross(normal, [0, 0, 1]) + rng.normal(0, 0.45, wall.shape)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    radius = rng.choice([1.1, 1.6, 2.3], len(wall), p=[0.35, 0.4, 0.25])
    sink, half_length = rng.uniform(0.1, 0.42, len(wall)), rng.uniform(0.8, 3.5, len(wall))
    for station in np.linspace(-1, 1, 9):
        path, normal = _on_wall(wall + station * half_length[:, None] * tangent, steps=3)
        # the burr lifts off at both ends
        subtract_burrs(cavity, path - normal * (radius - sink * (1.3 - station**2))[:, None], radius)
    np.maximum(cavity.values[box], kept - 0.4, out=cavity.values[box])

    subtract_burrs(cells, *_air_cells(rng, lower))
    behind_wall = np.where(cells.values < 0.45, cavity.values, 0)
    np.minimum(cavity.values, cells.values, out=cavity.values)
    grid.values = smooth_minimum(grid.values, cavity.values, 0.7)
    pits = ImplicitGrid(grid.lower, grid.upper, grid.spacing)
    subtract_burrs(pits, *_cortex_pits(rng))
    behind_wall = np.where(pits.values < 0.2, _cortex_height(x, y) - z, behind_wall)
    np.minimum(grid.values, pits.values, out=grid.values)
    return behind_wall


def _cortex_pits(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Balls (centres, radii) for a suture and the vascular foramina of the cortex, most of them above the canal."""
    at = np.concatenate([rng.normal([-9.5, 8.5], [3.0, 2.0], (20, 2)), rng.uniform([-36, -26], [31, 26], (30, 2))])
    radii = rng.uniform(0.25, 0.5, len(at))
    pits = np.column_stack([at, _cortex_height(*at.T) - 0.3 * radii])
    x = np.linspace(-36, 32, 500)
    y = 20.5 - 0.012 * (x + 2) ** 2 + 0.5 * np.sin(1.3 * x) + 0.3 * np.sin(3.1 * x)
    suture = np.column_stack([x, y, _cortex_height(x, y) + 0.1])
    return np.concatenate([pits, suture]), np.concatenate([radii, np.full(len(x), 0.4)])


def _on_wall(points: np.ndarray, steps: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Newton steps from ``(N, 3)`` points to the cavity's wall: points on it, and unit normals into the bone."""
    step = 0.05
    for _ in range(steps):
        probes = np.concatenate([points, *(points + step * axis for axis in np.eye(3))]).astype(np.float32)
        value, *ahead = _base_cavity(*probes.T).reshape(4, -1).astype(np.float64)
        gradient = (np.stack(ahead, axis=1) - value[:, None]) / step
        normal = gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-3)
        points = points - np.clip(value, -3, 3)[:, None] * normal
    return points, normal


def _air_cells(rng: np.random.Generator, lower: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres ``(N, 3)`` and radii of air cells that the walls cut open, in groups away from preserved structures."""
    wall, normal = _on_wall(rng.uniform(lower, [20, 14, 0], (600, 3)))
    x, y, z = wall.T
    tip, sinodural, zygomatic = y < -5, (x > 6) & (y > 2), (x < -3) & (x > -8) & (y > 5.5) & (z > -10)
    free = (z < -2.5) & (z > -16) & (_kept(x, y, z) < -1.0) & (tip | sinodural | zygomatic)
    seeds = np.flatnonzero(free)[:40]
    group = np.repeat(seeds, 15)
    radii = np.clip(rng.lognormal(np.log(0.55), 0.35, len(group)), 0.3, 1.1)
    centres, normal = _on_wall(wall[group] + rng.normal(0, 2.0, (len(group), 3)), steps=4)
    centres = centres + normal * (radii * rng.uniform(0.1, 0.75, len(group)))[:, None]
    # a second row behind the first, entered through it
    inner = rng.permutation(len(group))[: len(group) // 2]
    aside = rng.normal(0, 0.7, (len(inner), 3)) + normal[inner]
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    inner_radii = 0.8 * radii[inner]
    inner_centres = centres[inner] + aside * (0.8 * (radii[inner] + inner_radii))[:, None]
    centres, radii = np.concatenate([centres, inner_centres]), np.concatenate([radii, inner_radii])
    apart = (_kept(*centres.T) + radii < -0.5) & (centres[:, 2] + radii < -1.5)
    return centres[apart], radii[apart]


def _open_middle_ear(grid: ImplicitGrid) -> None:
    """Ear canal, attic, middle ear and facial recess, with a shell of bone left around the facial nerve."""
    near, far = np.array([-22.0, -9.0, -26.0]), np.array([-2.0, 13.0, 3.7])
    grid.carve(lambda x, y, z: polyline(x, y, z, CANAL, [4.5, 3.7]), near, far, blend=1.2)
    deep = np.array([-2.0, 13.0, -5.0])
    _, (x, y, z) = grid.box(near, deep)
    attic = polyline(x, y, z, np.array([[-4.5, 5.5, -14.5], [-13.0, 6.6, -15.2]]), [3.0, 2.9])
    roof = polyline(x, y, z, np.array([[-7.0, 8.0, -6.0], [-11.0, 7.4, -14.0]]), [2.4, 2.6])
    middle_ear = ball(x, y, z, (-13.6, 0.6, -20.8), (4.8, 5.8, 3.4))
    recess = polyline(x, y, z, np.array([[-6.6, -0.8, -14.0], [-10.8, -0.6, -20.0]]), [1.3, 1.1])
    air = np.minimum(np.minimum(attic, middle_ear), np.minimum(recess, roof))
    air = np.maximum(air, 1.25 - polyline(x, y, z, FACIAL_NERVE))
    grid.carve(lambda *_: air, near, deep, blend=0.4)


def _roughen(grid: ImplicitGrid, rng: np.random.Generator) -> None:
    """Add bone texture: plane waves of 0.8 to 6 mm in random directions, 0.05 mm root mean square in total."""
    band = np.nonzero(np.abs(grid.values) < 0.9)
    points = np.stack([axis[index] for axis, index in zip(grid.axes, band, strict=True)], axis=1)
    count = 36
    wavelength = np.geomspace(0.8, 6.0, count)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    wave = (direction * (2 * np.pi / wavelength)[:, None]).astype(np.float32)
    phase = rng.uniform(0, 2 * np.pi, count).astype(np.float32)
    amplitude = np.sqrt(wavelength)
    amplitude *= 0.05 / np.sqrt((amplitude**2).sum() / 2)
    texture = np.zeros(len(points), np.float32)
    for k in range(count):
        texture += np.float32(amplitude[k]) * np.sin(points @ wave[k] + phase[k])
    grid.values[band] += texture


def _tissue(local: np.ndarray, cell_depth: np.ndarray) -> dict[str, np.ndarray]:
    """``(V,)`` weights by name, see :class:`SampleSurface`."""
    x, y, z = local.T.astype(np.float32)

    def ramp(value: np.ndarray, zero: float, one: float) -> np.ndarray:
        return np.clip((value - zero) / (one - zero), 0, 1)

    canal = ramp(polyline(x, y, z, CANAL), 5.2, 4.7) * ramp(z, -17.5, -16.5)
    cavity = 1 - canal
    return {
        "drilled": ramp(_cortex_height(x, y) - z, 0.3, 1.0) * cavity,
        "air_cell": ramp(cell_depth, 0.1, 0.7),
        "mucosa": ramp(z + 0.35 * x, -17.0, -19.5) * cavity,
        "canal_skin": canal,
        "pool": ramp(z - 0.05 * np.maximum(x + 4, 0) ** 1.5, -15.5, -18.0) * cavity,
        "soft_tissue": ramp(np.hypot((x + 4) / 1.25, y + 1), 19.0, 24.0),
        "nerve": ramp(polyline(x, y, z, FACIAL_NERVE), 3.2, 1.8) * cavity,
    }


def _in_mesh_frame(local: TriangleMesh) -> TriangleMesh:
    return TriangleMesh(transform_points(MESH_FROM_LOCAL, local.vertices), local.faces)
