"""A user at Blender's window: what hands and eyes do there, by simulated events.

Every action that takes time is a generator, to be run with ``yield from``: it yields the seconds for which Blender is
to go on by itself. Places are pixels of the window, from its lower left corner, as Blender counts them.
"""

import time
from collections.abc import Callable, Generator
from pathlib import Path

import bpy
import numpy as np
import x11_capture
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

Action = Generator[float, None, None]
Place = tuple[float, float]

KEYS = {"0": "ZERO", "1": "ONE", "2": "TWO", "3": "THREE", "4": "FOUR", "5": "FIVE", "6": "SIX", "7": "SEVEN"}
KEYS |= {"8": "EIGHT", "9": "NINE", ".": "PERIOD", "-": "MINUS", "/": "SLASH", " ": "SPACE", ",": "COMMA"}
"""Blender's names of the keys whose characters are not letters."""
MODIFIER_KEYS = {"ctrl": "LEFT_CTRL", "shift": "LEFT_SHIFT", "alt": "LEFT_ALT", "oskey": "OSKEY"}
TURN_S = 0.05
"""One turn of Blender's event loop, and a redraw of what is small."""
HOVER_S = 0.15
"""How long the pointer rests on a button before Blender takes a click on it."""
COLUMNS = 0.3, 0.7, 0.12, 0.5, 0.88
"""Where buttons are looked for in the sidebar, in its width."""
ROW_STEP = 14
"""And how densely in its height; a button is 20 pixels high."""


class User:
    """The user of one scenario.

    Attributes
    ----------
    case
        The case file of the sample.
    folder
        Where the scenario may write what it likes.
    facts
        What the scenario measured, by name; printed with its result.
    """

    def __init__(self, case: Path, folder: Path, pictures: Path) -> None:
        self.case, self.folder, self.facts = case, folder, {}
        self._pictures = pictures
        self._draws = 0
        self._place: Place = (0, 0)
        self._seen: dict[str, Place] = {}
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
        """How the 3D view looks."""
        return self.area.spaces.active.region_3d

    def context(self, kind: str = "WINDOW"):
        """``with user.context(): bpy.ops...``, as if the pointer were in that region of the 3D view."""
        return bpy.context.temp_override(window=self.window, area=self.area, region=self.region(kind))

    def middle(self, kind: str = "WINDOW") -> Place:
        """The middle of a region of the 3D view."""
        region = self.region(kind)
        return region.x + region.width / 2, region.y + region.height / 2

    def of_point(self, point: tuple[float, float, float]) -> Place:
        """Where a point of the world appears."""
        region = self.region()
        found = location_3d_to_region_2d(region, self.view, Vector(point))
        if found is None:
            raise AssertionError(f"the point {tuple(point)} lies behind the view")
        return region.x + found.x, region.y + found.y

    def of_pixel(self, u: float, v: float) -> Place:
        """Where a pixel of the scene camera's image appears in camera view; (0, 0) is the top-left pixel's centre."""
        scene = bpy.context.scene
        right_top, _, left_bottom, left_top = scene.camera.data.view_frame(scene=scene)
        percent = scene.render.resolution_percentage / 100
        across = (u + 0.5) / (scene.render.resolution_x * percent)
        down = (v + 0.5) / (scene.render.resolution_y * percent)
        corner = left_top + across * (right_top - left_top) + down * (left_bottom - left_top)
        return self.of_point(scene.camera.matrix_world @ corner)

    # --- waiting ----------------------------------------------------------------------------------------------------

    def until(self, condition: Callable[[], object], what: str, timeout_s: float = 20.0) -> Action:
        """Wait until a condition holds; fails with ``what`` was expected."""
        end = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > end:
                raise AssertionError(f"expected within {timeout_s:g} s: {what}")
            yield TURN_S

    def redraw(self) -> Action:
        """Wait until the 3D view has been drawn as things are now."""
        drawn = self._draws
        self.area.tag_redraw()
        yield from self.until(lambda: self._draws > drawn, "a redraw of the 3D view", timeout_s=60)
        yield TURN_S

    # --- pointer and keys -------------------------------------------------------------------------------------------

    def event(self, kind: str, value: str, place: Place | None = None, **modifiers: object) -> None:
        """One event, at once; by keyword what is held (``ctrl``, ``shift``, ``alt``, ``oskey``), and ``unicode``."""
        self._place = place or self._place
        x, y = (round(number) for number in self._place)
        self.window.event_simulate(type=kind, value=value, x=x, y=y, **modifiers)

    def _hold(self, modifiers: dict[str, bool], value: str) -> None:
        """Press or release the modifier keys themselves; else Blender believes that they stay pressed."""
        for name in modifiers:
            self.event(MODIFIER_KEYS[name], value, **(modifiers if value == "PRESS" else {}))

    def move(self, place: Place) -> Action:
        """Rest the pointer at a place."""
        self.event("MOUSEMOVE", "NOTHING", place)
        yield HOVER_S
        # a button is hovered only by a second movement
        self.event("MOUSEMOVE", "NOTHING", (place[0] + 1, place[1]))
        yield TURN_S
        self.event("MOUSEMOVE", "NOTHING", place)
        yield HOVER_S

    def click(self, place: Place, button: str = "LEFTMOUSE", **modifiers: bool) -> Action:
        """Click there."""
        yield from self.move(place)
        self._hold(modifiers, "PRESS")
        self.event(button, "PRESS", place, **modifiers)
        yield TURN_S
        self.event(button, "RELEASE", place, **modifiers)
        self._hold(modifiers, "RELEASE")
        yield HOVER_S

    def drag(self, start: Place, end: Place, button: str = "LEFTMOUSE", *, steps: int = 8, **modifiers: bool) -> Action:
        """Press, move in steps, release."""
        yield from self.move(start)
        self._hold(modifiers, "PRESS")
        self.event(button, "PRESS", start, **modifiers)
        yield TURN_S
        for step in range(1, steps + 1):
            place = tuple(a + (b - a) * step / steps for a, b in zip(start, end, strict=True))
            self.event("MOUSEMOVE", "NOTHING", place, **modifiers)
            yield TURN_S
        self.event(button, "RELEASE", end, **modifiers)
        self._hold(modifiers, "RELEASE")
        yield HOVER_S

    def key(self, kind: str, place: Place | None = None, **modifiers: bool) -> Action:
        """Press and release a key; by default where the pointer is."""
        if place:
            yield from self.move(place)
        self._hold(modifiers, "PRESS")
        self.event(kind, "PRESS", **modifiers)
        self.event(kind, "RELEASE", **modifiers)
        self._hold(modifiers, "RELEASE")
        yield HOVER_S

    def type_text(self, text: str) -> Action:
        """Type into the field that is being edited."""
        for character in text:
            kind = KEYS.get(character, character.upper() if character.isalpha() else "NONE")
            self.event(kind, "PRESS", unicode=character)
            self.event(kind, "RELEASE")
            yield 0.02

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

    def hovered(self, kind: str = "UI") -> str:
        """The button under the pointer: ``oneframe.solve()``, or the path of a property; empty if there is none."""
        manager = bpy.context.window_manager
        with self.context(kind):
            if bpy.ops.ui.copy_python_command_button.poll():
                bpy.ops.ui.copy_python_command_button()
                return manager.clipboard.removeprefix("bpy.ops.")
            if bpy.ops.ui.copy_data_path_button.poll():
                bpy.ops.ui.copy_data_path_button(full_path=True)
                return manager.clipboard
        return ""

    def find(self, name: str) -> Generator[float, None, Place]:
        """Look for a button of the sidebar, from top to bottom: part of its command or of its property's path."""
        for found, place in self._seen.items():
            if name in found:
                yield from self.move(place)
                if name in self.hovered():
                    return place
        self._seen.clear()
        sidebar = self.region("UI")
        if sidebar.width <= 1:
            raise AssertionError(f"expected an open sidebar to look for {name!r} in")
        with self.context("UI"):
            # as far up as it goes
            bpy.ops.view2d.scroll_up(page=True, deltay=100_000)
        yield HOVER_S
        scrolled_to = None
        while scrolled_to != (scrolled_to := sidebar.view2d.region_to_view(0, 0)[1]):
            for across in COLUMNS:
                for below in range(10, sidebar.height, ROW_STEP):
                    place = (sidebar.x + across * sidebar.width, sidebar.y + sidebar.height - below)
                    self.event("MOUSEMOVE", "NOTHING", place)
                    yield 0.08
                    if found := self.hovered():
                        self._seen.setdefault(found, place)
                    if name in found:
                        yield from self.move(place)
                        if name in self.hovered():
                            return place
            with self.context("UI"):
                bpy.ops.view2d.scroll_down(page=True)
            yield HOVER_S
        raise AssertionError(f"expected a button {name!r} in the sidebar, found {', '.join(self._seen) or 'none'}")

    def press(self, name: str) -> Action:
        """Click the button with that command, or the property of that path."""
        place = yield from self.find(name)
        yield from self.click(place)

    def type_into(self, name: str, text: str) -> Action:
        """Replace what stands in a field of the sidebar."""
        place = yield from self.find(name)
        # over a field, Return starts the editing of its text, all of it selected
        yield from self.key("RET", place)
        yield from self.type_text(text)
        yield from self.key("RET")

    # --- files ------------------------------------------------------------------------------------------------------

    def choose_file(self, path: Path) -> Action:
        """Choose a file in the file selector that has opened, which may not be there yet."""
        yield from self.until(lambda: self._selector() and self._selector().spaces.active.params, "a file selector")
        yield 0.3
        selector = self._selector()
        parameters = selector.spaces.active.params
        parameters.directory, parameters.filename = str(path.parent).encode(), path.name
        yield 0.3
        yield from self.key("RET", (selector.x + selector.width / 2, selector.y + selector.height / 2))
        yield from self.until(lambda: not self._selector(), "the file selector to close", timeout_s=60)
        yield from self.redraw()

    def _selector(self) -> bpy.types.Area | None:
        return next((area for area in self.window.screen.areas if area.type == "FILE_BROWSER"), None)

    # --- looking ----------------------------------------------------------------------------------------------------

    def picture(self, name: str) -> Action:
        """Keep a picture of the whole window under a name."""
        for area in self.window.screen.areas:
            area.tag_redraw()
        if any(area.type == "VIEW_3D" for area in self.window.screen.areas):
            yield from self.redraw()
        yield 0.3
        np.save(self._pictures / f"{name}.npy", x11_capture.capture())
