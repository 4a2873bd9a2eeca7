"""A user at Blender's window: pointer and keys as simulated events, waiting, what the buttons do, files, pictures.

Every action that takes time is a generator for ``yield from``: it yields the seconds for which Blender runs before the
next step. Places are pixels of the window, from its lower left corner, as in Blender.
"""

import time
from collections.abc import Callable, Generator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import x11
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

Action = Generator[float, None, None]
Place = tuple[float, float]

MODIFIER_KEYS = {"ctrl": "LEFT_CTRL", "shift": "LEFT_SHIFT", "alt": "LEFT_ALT", "oskey": "OSKEY"}
LOOP_S = 0.05
"""Time for one iteration of Blender's event loop, with a small redraw."""

HOVER_S = 0.15
"""Time that the pointer rests on a button before Blender accepts a click on it."""


class Hands:
    """Pointer and keyboard of one user, at the first window and its largest 3D view."""

    def __init__(self) -> None:
        self._draws = 0
        self._place: Place = (0, 0)
        bpy.types.SpaceView3D.draw_handler_add(self._count_draw, (), "WINDOW", "POST_PIXEL")

    def _count_draw(self) -> None:
        self._draws += 1

    # --- where things are -------------------------------------------------------------------------------------------

    @property
    def window(self) -> bpy.types.Window:
        """The first window."""
        return bpy.context.window_manager.windows[0]

    @property
    def area(self) -> bpy.types.Area:
        """The largest 3D view."""
        views = [area for area in self.window.screen.areas if area.type == "VIEW_3D"]
        return max(views, key=lambda area: area.width * area.height)

    def region(self, kind: str = "WINDOW", area: bpy.types.Area | None = None) -> bpy.types.Region:
        """A region of the 3D view, or of another area."""
        return next(region for region in (area or self.area).regions if region.type == kind)

    @property
    def view(self) -> bpy.types.RegionView3D:
        """The 3D view's settings: perspective, position, zoom."""
        return self.area.spaces.active.region_3d

    def context(self, kind: str = "WINDOW"):
        """``with user.context(): bpy.ops...``, as if the pointer were in that region of the 3D view."""
        return bpy.context.temp_override(window=self.window, area=self.area, region=self.region(kind))

    def middle(self, kind: str = "WINDOW") -> Place:
        """The middle of a region of the 3D view."""
        region = self.region(kind)
        return region.x + region.width / 2, region.y + region.height / 2

    def of_point(self, point: tuple[float, float, float]) -> Place:
        """The position of a point of the world in the window."""
        region = self.region()
        found = location_3d_to_region_2d(region, self.view, Vector(point))
        if found is None:
            raise AssertionError(f"the point {tuple(point)} lies behind the view")
        return region.x + found.x, region.y + found.y

    def of_pixel(self, u: float, v: float) -> Place:
        """The position of a pixel of the scene camera's image in camera view; (0, 0) is the top-left pixel's centre."""
        scene = bpy.context.scene
        right_top, _, left_bottom, left_top = scene.camera.data.view_frame(scene=scene)
        percent = scene.render.resolution_percentage / 100
        across = (u + 0.5) / (scene.render.resolution_x * percent)
        down = (v + 0.5) / (scene.render.resolution_y * percent)
        corner = left_top + across * (right_top - left_top) + down * (left_bottom - left_top)
        return self.of_point(scene.camera.matrix_world @ corner)

    # --- waiting ----------------------------------------------------------------------------------------------------

    def until(self, condition: Callable[[], object], what: str, timeout_s: float = 300.0) -> Action:
        """Wait until a condition holds; ``what`` names it in the message of a failure."""
        end = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > end:
                raise AssertionError(f"expected within {timeout_s:g} s: {what}")
            yield LOOP_S

    def redraw(self) -> Action:
        """Wait until the 3D view has been drawn again."""
        drawn = self._draws
        self.area.tag_redraw()
        yield from self.until(lambda: self._draws > drawn, "a redraw of the 3D view")
        yield LOOP_S

    # --- pointer and keys -------------------------------------------------------------------------------------------

    def event(self, kind: str, value: str, place: Place | None = None, **modifiers: object) -> None:
        """Send one event; keywords are modifiers held (``ctrl``, ``shift``, ``alt``, ``oskey``) and ``unicode``."""
        self._place = place or self._place
        x, y = (round(number) for number in self._place)
        self.window.event_simulate(type=kind, value=value, x=x, y=y, **modifiers)

    def _hold(self, modifiers: dict[str, bool], value: str) -> None:
        """Press or release the modifier keys; without their own events, Blender keeps them pressed."""
        for name in modifiers:
            self.event(MODIFIER_KEYS[name], value, **(modifiers if value == "PRESS" else {}))

    def move(self, place: Place) -> Action:
        """Rest the pointer at a place."""
        self.event("MOUSEMOVE", "NOTHING", place)
        yield HOVER_S
        # a button reacts to the second movement only
        self.event("MOUSEMOVE", "NOTHING", (place[0] + 1, place[1]))
        yield LOOP_S
        self.event("MOUSEMOVE", "NOTHING", place)
        yield HOVER_S

    def click(self, place: Place, button: str = "LEFTMOUSE", **modifiers: bool) -> Action:
        """Click there."""
        yield from self.move(place)
        self._hold(modifiers, "PRESS")
        self.event(button, "PRESS", place, **modifiers)
        yield LOOP_S
        self.event(button, "RELEASE", place, **modifiers)
        self._hold(modifiers, "RELEASE")
        yield HOVER_S

    def drag(self, start: Place, end: Place, button: str = "LEFTMOUSE", *, steps: int = 8, **modifiers: bool) -> Action:
        """Press, move in steps, release."""
        yield from self.move(start)
        self._hold(modifiers, "PRESS")
        self.event(button, "PRESS", start, **modifiers)
        yield LOOP_S
        for step in range(1, steps + 1):
            place = tuple(a + (b - a) * step / steps for a, b in zip(start, end, strict=True))
            self.event("MOUSEMOVE", "NOTHING", place, **modifiers)
            yield LOOP_S
        self.event(button, "RELEASE", end, **modifiers)
        self._hold(modifiers, "RELEASE")
        yield HOVER_S

    def key(self, kind: str, place: Place | None = None, **modifiers: bool) -> Action:
        """Press and release a key, by default at the current place of the pointer."""
        if place:
            yield from self.move(place)
        self._hold(modifiers, "PRESS")
        self.event(kind, "PRESS", **modifiers)
        self.event(kind, "RELEASE", **modifiers)
        self._hold(modifiers, "RELEASE")
        yield HOVER_S


PACKAGE = "bl_ext.user_default.oneframe"


def part(name: str) -> ModuleType:
    """A module of the installed add-on, by its name in it."""
    return import_module(f"{PACKAGE}.{name}")


class User(Hands):
    """The user of one scenario.

    Attributes
    ----------
    case
        The case file of the sample.
    folder
        Folder for the scenario's own files.
    facts
        Measurements of the scenario by name; printed with its result.
    """

    def __init__(self, case: Path, folder: Path, pictures: Path) -> None:
        super().__init__()
        self.case, self.folder, self.facts = case, folder, {}
        self._pictures = pictures

    # --- the sidebar ------------------------------------------------------------------------------------------------

    def open_sidebar(self, tab: str) -> Action:
        """Show the sidebar of the 3D view with one of its tabs."""
        self.area.spaces.active.show_region_ui = True
        # the tabs exist once the sidebar has been drawn
        yield from self.until(lambda: self.region("UI").width > 1, "the sidebar")
        yield from self.until(lambda: self._has_tab(tab), f"the tab {tab} in the sidebar")
        self.area.tag_redraw()
        yield 0.4

    def _has_tab(self, tab: str) -> bool:
        sidebar = self.region("UI")
        try:
            sidebar.active_panel_category = tab
        except (AttributeError, TypeError):  # read-only before the sidebar is drawn; no such tab yet
            self.area.tag_redraw()
            return False
        return sidebar.active_panel_category == tab

    def press(self, name: str, **settings: object) -> Action:
        """Call an operator of the add-on as its button in the sidebar does."""
        yield from self.move(self.middle())
        with self.context("UI"):
            getattr(bpy.ops.oneframe, name)("INVOKE_DEFAULT", True, **settings)
        yield HOVER_S

    def call(self, name: str, *how: object, **settings: object) -> set[str]:
        """Call an operator of the add-on in the 3D view; ``how``: its context and whether it is an undo step."""
        with self.context():
            return getattr(bpy.ops.oneframe, name)(*how, **settings)

    def take_tool(self, name: str) -> Action:
        """Choose a tool of the toolbar."""
        with self.context():
            bpy.ops.wm.tool_set_by_id(name=name)
        yield from self.redraw()

    def undo(self, condition: Callable[[], object], what: str) -> Action:
        """Undo a step by its key, and wait as :meth:`until` does."""
        yield from self.key("Z", self.middle(), ctrl=True)
        yield from self.until(condition, what)

    def redo(self, condition: Callable[[], object], what: str) -> Action:
        """The same the other way."""
        yield from self.key("Z", self.middle(), ctrl=True, shift=True)
        yield from self.until(condition, what)

    # --- the workbench ---------------------------------------------------------------------------------------------

    def open_case(self, case: Path | None = None) -> Action:
        """Open a case as one undo step, and wait for the add-on's own workspace."""
        with self.context():
            bpy.ops.oneframe.open_case("EXEC_DEFAULT", True, filepath=str(case or self.case))
        yield from self.at_workbench()

    def at_workbench(self) -> Action:
        """Wait until the add-on's own workspace shows its scene, with the whole frame in view."""
        yield from self.until(
            lambda: "oneframe_workspace" in self.window.workspace and "oneframe_workbench" in self.window.scene,
            "the add-on's workspace with its scene",
        )
        yield from self.redraw()
        yield 0.3
        yield from self.redraw()

    def plain_view(self) -> None:
        """Show the surface as Blender does: what the add-on draws over it takes software OpenGL most of a redraw."""
        scene = bpy.context.scene
        scene.oneframe_view.opacity, scene.oneframe_view.contour = 1.0, False
        for structure in scene.oneframe.surface.children:
            structure.hide_viewport = True

    @property
    def pose(self) -> np.ndarray:
        """The surface's pose, camera from model."""
        return part("state.from_scene").cam_from_model(self.window.scene)

    @property
    def frame_view(self) -> object:
        """Where the frame is in the 3D view."""
        return part("ui.frame_view").FrameView.of(self.window.scene, self.region(), self.view)

    # --- looking ----------------------------------------------------------------------------------------------------

    def look(self) -> Generator[float, None, np.ndarray]:
        """The picture of the window once two in a row are equal, so that all drawing is on the screen."""
        before = None
        for _ in range(25):
            now = x11.capture()
            if before is not None and np.array_equal(now, before):
                return now
            before = now
            yield 0.2
        raise AssertionError("expected two equal pictures of the window in a row, found none in 25")

    def picture(self, name: str) -> Action:
        """Save a picture of the whole window under a name."""
        for area in self.window.screen.areas:
            area.tag_redraw()
        if any(area.type == "VIEW_3D" for area in self.window.screen.areas):
            yield from self.redraw()
        yield 0.3
        np.save(self._pictures / f"{name}.npy", x11.capture())
