"""A user at Blender's window, who knows what the buttons do, chooses files and keeps pictures.

Every action that takes time is a generator, to be run with ``yield from``: see :mod:`hands`.
"""

from collections.abc import Callable, Generator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import x11
from hands import HOVER_S, Action, Hands

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

    # --- files ------------------------------------------------------------------------------------------------------

    def choose_file(self, path: Path) -> Action:
        """Choose a file in the file selector; waits for it to open."""
        selector = yield from self.file_selector()
        parameters = selector.spaces.active.params
        parameters.directory, parameters.filename = str(path.parent).encode(), path.name
        yield from self.leave_file_selector("RET")

    def leave_file_selector(self, key: str = "ESC") -> Action:
        """Cancel the file selector, or accept what it has; waits for it to open, and to close."""
        selector = yield from self.file_selector()
        yield from self.key(key, (selector.x + selector.width / 2, selector.y + selector.height / 2))
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
