"""The drilled volume in memory while the drill is in use: its field, and the surface in blocks.

The burr stops where a margin begins, so what is shown is what stays but for a fraction of a voxel; Make Surface holds
the margins on the finished surface, as the command does. The strokes stand in the scene's settings: after undo and
redo the session follows them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy_extras import view3d_utils

from ..class_registration import at_end, listening
from ..pipeline.blender.alignment import surface_object
from ..pipeline.surface.mesh import TriangleMesh
from ..pipeline.volume.bone.bone import bone_voxels
from ..pipeline.volume.bone.isosurface import RemovedField, block_surface
from ..pipeline.volume.drill.burr import BurrRoom, first_bone
from ..pipeline.volume.drill.drill_plan import DrillPlan, Stroke
from ..pipeline.volume.drill.virtual_drill import DrilledVolume, VoxelBox, drilled
from ..state import from_scene
from ..state.events import redraw
from . import drill_strokes
from .loaded import Key, LoadedCT, ct_of, key_of

BLOCK = 32
"""Cells along an axis of the blocks: few enough to make again at once, and not too many to draw."""

DEPTH = 0.5
"""How deep a stroke goes, in radii of the burr."""

APPROACH = 1.5
"""So many radii before the bone, and nearer, the burr looks for room between margins."""

BlockKey = tuple[int, int, int]


@dataclass(frozen=True)
class Block:
    """Part of the surface, LPS mm: ``(V, 3)`` and ``(V,)`` float32, 1 where drilled, and ``(F, 3)`` int32."""

    vertices: np.ndarray
    drilled: np.ndarray
    faces: np.ndarray


class DrillSession:
    """One CT at one threshold, with its strokes. Mutable: every motion of the burr changes it."""

    def __init__(
        self, ct: LoadedCT, level_hu: float, solid: np.ndarray,
        structures: Mapping[str, TriangleMesh], margins_mm: Mapping[str, float],
    ) -> None:  # fmt: skip
        """Begin with nothing drilled; ``room`` is that of the burr between structures."""
        self.ct, self.level_hu, self.solid, self.structures = ct, level_hu, solid, dict(structures)
        self.blocks: dict[BlockKey, Block] = {}
        self.changed: set[BlockKey] = set()
        self.revision = 0
        self._drilled = DrilledVolume(ct.volume.grid)
        self.margins_mm = dict(margins_mm)
        self.room = BurrRoom(structures, margins_mm)
        self.said = ""

    def spare(self, margins_mm: Mapping[str, float]) -> None:
        """Stop the burr at other margins from now on."""
        if self.margins_mm != margins_mm:
            self.margins_mm = dict(margins_mm)
            self.room = BurrRoom(self.structures, margins_mm)

    @property
    def removed(self) -> RemovedField | None:
        """What was drilled so far."""
        return self._drilled.removed

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        """In the order of drilling."""
        return self._drilled.strokes

    def begin(self, radius_mm: float, point: np.ndarray) -> None:
        """Begin a stroke."""
        self._renew(self._drilled.add(Stroke(radius_mm, point[None])))

    def extend(self, points: Sequence[np.ndarray]) -> None:
        """Move the burr on to points."""
        self._renew(*[self._drilled.extend(point) for point in points])

    @property
    def taken_mm3(self) -> float:
        """Bone that was drilled so far, roughly: of voxels at the burr's surface a part."""
        if self.removed is None:
            return 0.0
        grid = self.ct.volume.grid
        share = np.clip(0.5 - self.removed.distance_mm / grid.spacing_mm.min(), 0, 1)
        return float(share[self.solid[self.removed.slices]].sum(dtype=np.float64)) * grid.voxel_mm3

    def undo(self) -> None:
        """Take back the last stroke."""
        self._renew(self._drilled.undo())

    def follow(self, strokes: Sequence[Stroke]) -> None:
        """Drill these strokes, no others."""
        same = 0
        for old, new in zip(self.strokes, strokes, strict=False):
            if old.radius_mm != new.radius_mm or not np.array_equal(old.points, new.points):
                break
            same += 1
        for _ in range(len(self.strokes) - same):
            self.undo()
        for stroke in strokes[same:]:
            self._renew(self._drilled.add(stroke))

    def make_all(self, progress: Callable[[float], None]) -> None:
        """Make all blocks."""
        counts = [-(-(count + 1) // BLOCK) for count in self.ct.volume.grid.size]
        keys = [(x, y, z) for z in range(counts[2]) for y in range(counts[1]) for x in range(counts[0])]
        for number, key in enumerate(keys):
            self._make(key)
            progress((number + 1) / len(keys))

    def hit(self, removed: RemovedField | None, origin_mm: np.ndarray, direction: np.ndarray) -> np.ndarray | None:
        """Where a ray meets the bone that a field has left."""
        return first_bone(self.ct.volume, self.level_hu, self.solid, removed, origin_mm, direction)

    def _renew(self, *boxes: VoxelBox) -> None:
        """Make the blocks again that voxels belong to."""
        keys: set[BlockKey] = set()
        for box in boxes:
            if not box.is_empty:
                # cells begin at -1, and a voxel is a corner of the cell before it
                low, high = box.first // BLOCK, box.stop // BLOCK
                across, down, deep = (range(int(a), int(b) + 1) for a, b in zip(low, high, strict=True))
                keys |= set(product(across, down, deep))
        self.revision += bool(keys)
        for key in keys:
            self._make(key)

    def _make(self, key: BlockKey) -> None:
        volume = self.ct.volume
        x, y, z = (at * BLOCK - 1 for at in key)
        right, down, deep = (min(at + BLOCK, count) for at, count in zip((x, y, z), volume.grid.size, strict=True))
        if right <= x or down <= y or deep <= z:
            return
        made = block_surface(
            volume.values, self.level_hu, volume.grid, (x, y, z), (right, down, deep),
            solid=self.solid, removed=self.removed,
        )  # fmt: skip
        self.changed.add(key)
        if len(made.mesh.faces) == 0:
            self.blocks.pop(key, None)
            return
        self.blocks[key] = Block(
            made.mesh.vertices.astype(np.float32),
            made.drilled.astype(np.float32),
            np.ascontiguousarray(made.mesh.faces, np.int32),
        )


def prepared(
    ct: LoadedCT, level_hu: float, plan: DrillPlan, structures: Mapping[str, TriangleMesh],
    progress: Callable[[float], None],
) -> DrillSession:  # fmt: skip
    """A session with the strokes of a plan; for a thread."""
    solid = bone_voxels(ct.volume, level_hu)
    progress(0.2)
    session = DrillSession(ct, level_hu, solid, structures, plan.margins_mm)
    session.follow(plan.strokes)
    session.make_all(lambda share: progress(0.4 + 0.6 * share))
    return session


def world_from_mesh(scene: bpy.types.Scene) -> np.ndarray:
    """``(4, 4)``: LPS mm -> the world of Blender, as the surface lies."""
    surface = from_scene.surface_of(scene)
    world_from_model = np.array(surface.matrix_world, np.float64)
    return world_from_model @ np.linalg.inv(surface_object.mesh_from_model_of(surface))


@dataclass(frozen=True)
class Burr:
    """The burr under the pointer.

    Attributes
    ----------
    centre
        ``(3,)`` LPS, mm.
    radius_mm
        Its radius.
    stopped
        Whether a margin holds it back.
    has_room
        Whether it drills; otherwise it only touches the bone, in a margin.
    structure, distance_mm
        The nearest structure, and its distance from the burr's surface; no name if there is none.
    """

    centre: np.ndarray
    radius_mm: float
    stopped: bool
    has_room: bool
    structure: str
    distance_mm: float


def burr_radius_mm(scene: bpy.types.Scene) -> float:
    """The burr's radius, as strokes keep it."""
    return float(drill_strokes.rounded(np.array(float(scene.oneframe_ct.burr_mm) / 2)))


def burr_at(
    context: bpy.types.Context, session: DrillSession, removed: RemovedField | None, at: tuple[float, float]
) -> Burr | None:
    """The burr on the bone that a field has left, under a place of the region (px); ``None`` beside the bone."""
    region, region_3d = context.region, context.region_data
    origin = np.array(view3d_utils.region_2d_to_origin_3d(region, region_3d, at))
    toward = np.array(view3d_utils.region_2d_to_vector_3d(region, region_3d, at))
    mesh_from_world = np.linalg.inv(world_from_mesh(context.scene))
    origin = mesh_from_world[:3, :3] @ origin + mesh_from_world[:3, 3]
    toward = mesh_from_world[:3, :3] @ toward
    toward /= np.linalg.norm(toward)
    hit = session.hit(removed, origin, toward)
    if hit is None:
        return None
    radius = burr_radius_mm(context.scene)
    wanted = hit - (1 - DEPTH) * radius * toward
    reached = session.room.reached(hit - APPROACH * radius * toward, wanted, radius)
    centre = drill_strokes.rounded(hit - radius * toward if reached is None else reached)
    stopped = reached is None or bool(np.linalg.norm(reached - wanted) > 1e-6)
    near = session.room.nearest(centre)
    name, distance = ("", np.inf) if near is None else near
    return Burr(centre, radius, stopped, reached is not None, name, distance - radius)


_Kept = tuple[Key, float]
_session: tuple[_Kept, DrillSession] | None = None

_marks: dict[tuple[int, str], tuple[LoadedCT, RemovedField | None]] = {}
"""What the slices show of strokes after drilling, by CT and strokes; the CT itself keeps its id."""


def _what(scene: bpy.types.Scene) -> _Kept | None:
    key, settings = key_of(scene), scene.oneframe_ct
    return None if key is None else (key, settings.threshold_hu)


def of(scene: bpy.types.Scene) -> DrillSession | None:
    """The scene's session, while it drills: ``None`` if CT, labels or threshold are others."""
    if _session is None or not scene.oneframe_ct.drilling or ct_of(scene) is not _session[1].ct:
        return None
    if _session[0] != _what(scene):
        return None
    _session[1].spare(drill_strokes.margins_in(scene))
    return _session[1]


def keep(scene: bpy.types.Scene, session: DrillSession) -> None:
    """Keep a session as the scene's."""
    global _session
    what = _what(scene)
    _session = None if what is None else (what, session)


def removed_in(scene: bpy.types.Scene, ct: LoadedCT) -> RemovedField | None:
    """What the scene's strokes remove, margins apart: while the drill is in use, and after."""
    session, key = of(scene), (id(ct), scene.oneframe_ct.strokes_text)
    if session is not None:
        return session.removed
    if key not in _marks:
        _marks.clear()
        _marks[key] = ct, drilled(DrillPlan(drill_strokes.strokes_of(scene)), ct.volume.grid).removed
    return _marks[key][1]


def surface_hidden(scene: bpy.types.Scene, hidden: bool) -> None:
    """Hide the surface while its blocks are drawn instead, or show it again."""
    surface = from_scene.present_surface(scene)
    for layer in scene.view_layers:
        if surface is not None and surface.name in layer.objects:
            surface.hide_set(hidden, view_layer=layer)


def end(scene: bpy.types.Scene) -> None:
    """End the use of the drill; what was drilled stays."""
    global _session
    if (session := of(scene)) is not None:
        _marks.clear()
        _marks[id(session.ct), scene.oneframe_ct.strokes_text] = session.ct, session.removed
    scene.oneframe_ct.drilling = False
    surface_hidden(scene, False)
    _session = None


@persistent
def _after_undo(*_: object) -> None:
    for scene in bpy.data.scenes:
        session = of(scene)
        if session is not None:
            session.follow(drill_strokes.strokes_of(scene))
            redraw()


@persistent
def _after_load(*_: object) -> None:
    """A file that was saved while drilling shows its surface."""
    for scene in bpy.data.scenes:
        if scene.oneframe_ct.drilling:
            end(scene)


# a file that is saved while drilling, and the scene without the add-on, show the surface
PARTS = (
    at_end(_after_load, _marks.clear),
    listening(bpy.app.handlers.undo_post, _after_undo),
    listening(bpy.app.handlers.redo_post, _after_undo),
    listening(bpy.app.handlers.load_post, _after_load),
)
