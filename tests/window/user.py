"""A user at Blender's window, who knows what the buttons of the sidebar do, chooses files and keeps pictures.

Every action that takes time is a generator, to be run with ``yield from``: see :mod:`hands`.
"""

from collections.abc import Callable, Generator
from importlib import import_module
from pathlib import Path

import bpy
import numpy as np
import sidebar_picture
import x11
from hands import HOVER_S, Action, Hands, Place

FAR = 100_000
"""Pixels, more than any sidebar is long."""


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
        # position of each button: pixels from the sidebar's left edge, and from the top of its content (negative)
        self._seen: dict[str, Place] = {}

    # --- the sidebar ------------------------------------------------------------------------------------------------

    def open_sidebar(self, tab: str) -> Action:
        """Show the sidebar of the 3D view with one of its tabs."""
        self.area.spaces.active.show_region_ui = True
        # the tabs exist once the sidebar has been drawn
        yield from self.until(lambda: self.region("UI").width > 1, "the sidebar")
        yield from self.until(lambda: self._has_tab(tab), f"the tab {tab} in the sidebar")
        self._seen.clear()
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

    def closed_panels(self) -> list[Place]:
        """Where to click to open the visible panels, from top to bottom."""
        return self._seen_in_sidebar(sidebar_picture.closed_panels)

    def _seen_in_sidebar(self, look: Callable[[np.ndarray], list[tuple[int, int]]]) -> list[Place]:
        sidebar = self.region("UI")
        top = self.window.height - sidebar.y - sidebar.height
        picture = x11.capture()[top : top + sidebar.height, sidebar.x : sidebar.x + sidebar.width]
        return [(sidebar.x + x, sidebar.y + sidebar.height - 1 - y) for x, y in look(picture)]

    def show_step(self, step: str, *, parts: bool = False) -> Action:
        """Click the line of a closed step of the work, and open its parts if wanted."""
        steps = import_module("bl_ext.user_default.oneframe.ui.step_panel")
        # the line Queue stands above them
        there = ["queue", *steps.STEPS] if bpy.types.ONEFRAME_PT_view.poll(bpy.context) else ["ct", "setup"]
        yield from self._look_elsewhere()
        if (shown := steps.shown(bpy.context.scene)) != step:
            places = yield from self._all_closed()
            # closed parts of the open step lie between its line and the next one
            at = there.index(step)
            after = shown in there and at > there.index(shown)
            place = places[at - len(there)] if after else places[at]
            yield from self._scroll_to(place[1])
            yield from self.click(self._in_window(place))
            yield from self._look_elsewhere()
        assert steps.shown(bpy.context.scene) == step
        self._seen.clear()
        while parts and len(places := (yield from self._all_closed())) >= len(there):
            at = there.index(step)
            yield from self._scroll_to(places[at][1])
            yield from self.click(self._in_window(places[at]))
            yield from self._look_elsewhere()
        yield from self._scroll(FAR)

    def _all_closed(self) -> Generator[float, None, list[Place]]:
        """The arrows of all closed panels, from top to bottom of the sidebar's content."""
        yield from self._scroll(FAR)
        found: dict[int, Place] = {}
        while True:
            for place in map(self._in_content, self.closed_panels()):
                found.setdefault(round(place[1] / 8), place)
            if not (yield from self._scroll_on()):
                return [found[height] for height in sorted(found, reverse=True)]

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
        """Look for a button of the sidebar, from top to bottom: part of its command or of its property's path.

        Buttons in closed panels are not seen. A button seen before is looked for first where it was.
        """
        if self.region("UI").width <= 1:
            raise AssertionError(f"expected an open sidebar to look for {name!r} in")
        if found := next((found for found in self._seen if name in found), None):
            yield from self._scroll_to(self._seen[found][1])
            place = self._in_window(self._seen[found])
            yield from self.move(place)
            if name in self.hovered():
                return place
        self._seen.clear()
        yield from self._scroll(FAR)
        before = ""
        while True:
            yield from self._look_elsewhere()
            for place in self._seen_in_sidebar(sidebar_picture.likely_buttons):
                self.event("MOUSEMOVE", "NOTHING", place)
                yield 0.08
                found = self.hovered()
                if found == before:  # Blender may not have updated yet
                    yield HOVER_S
                    found = self.hovered()
                if before := found:
                    self._seen.setdefault(found, self._in_content(place))
                if name in found:
                    yield from self.move(place)
                    if name in self.hovered():
                        return place
            if not (yield from self._scroll_on()):
                break
        raise AssertionError(f"expected a button {name!r} in the sidebar, found {', '.join(self._seen) or 'none'}")

    def press(self, name: str) -> Action:
        """Click the button with that command, or the property of that path."""
        place = yield from self.find(name)
        yield from self.click(place)

    def _in_content(self, place: Place) -> Place:
        sidebar = self.region("UI")
        return place[0] - sidebar.x, sidebar.view2d.region_to_view(0, place[1] - sidebar.y)[1]

    def _in_window(self, place: Place) -> Place:
        sidebar = self.region("UI")
        return place[0] + sidebar.x, sidebar.view2d.view_to_region(0, place[1], clip=False)[1] + sidebar.y

    def _scroll(self, up_px: float) -> Action:
        with self.context("UI"):
            bpy.ops.view2d.pan(deltax=0, deltay=round(up_px))
        self.area.tag_redraw()
        yield HOVER_S

    def _scroll_on(self) -> Generator[float, None, bool]:
        """Scroll down by a little less than the sidebar's height; returns False at the end."""
        sidebar = self.region("UI")
        before = sidebar.view2d.region_to_view(0, 0)[1]
        yield from self._scroll(60 - sidebar.height)
        return sidebar.view2d.region_to_view(0, 0)[1] < before

    def _scroll_to(self, height: float) -> Action:
        """Scroll until that height of the content is visible."""
        sidebar = self.region("UI")
        below = sidebar.view2d.region_to_view(0, 30)[1] - height
        above = height - sidebar.view2d.region_to_view(0, sidebar.height - 30)[1]
        if max(below, above) > 0:
            yield from self._scroll(above if above > 0 else -below)

    def _look_elsewhere(self) -> Action:
        """Move the pointer off the sidebar, so that nothing is highlighted there."""
        yield from self.move(self.middle())

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

    # --- files ------------------------------------------------------------------------------------------------------

    def choose_file(self, path: Path) -> Action:
        """Choose a file in the file selector; waits for it to open."""
        selector = yield from self.file_selector()
        parameters = selector.spaces.active.params
        parameters.directory, parameters.filename = str(path.parent).encode(), path.name
        yield from self.accept_file()

    def accept_file(self) -> Action:
        """Accept the file that the file selector suggests; waits for it to open."""
        selector = yield from self.file_selector()
        yield from self.key("RET", (selector.x + selector.width / 2, selector.y + selector.height / 2))
        yield from self.until(lambda: not self._selector(), "the file selector to close")
        yield from self.redraw()

    def file_selector(self) -> Generator[float, None, bpy.types.Area]:
        """The file selector, once it is open."""
        yield from self.until(lambda: self._selector() and self._selector().spaces.active.params, "a file selector")
        yield 0.3
        return self._selector()

    def _selector(self) -> bpy.types.Area | None:
        return next((area for area in self.window.screen.areas if area.type == "FILE_BROWSER"), None)

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
