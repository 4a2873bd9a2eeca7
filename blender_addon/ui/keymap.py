"""The add-on's tools and their keys: bound in the tools only, and shown where they would act now.

Other tools and modes keep Blender's own keys, and so do these with Ctrl, but for mouse and wheel: Ctrl is Blender's.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy

from ..class_registration import Part

PIN_TOOL, LANDMARK_TOOL, MOVE_TOOL = "oneframe.pin_tool", "oneframe.landmark_tool", "oneframe.move_tool"
MASK_TOOL = "oneframe.mask_tool"
ALIGNMENT_TOOLS = (PIN_TOOL, LANDMARK_TOOL, MOVE_TOOL)
TOOLS = {
    PIN_TOOL: "Pins",
    LANDMARK_TOOL: "Landmarks",
    MOVE_TOOL: "Move Surface",
    MASK_TOOL: "Mask",
}
"""Tools of the toolbar and their labels."""


class ViewTool(bpy.types.WorkSpaceTool):
    """Base of the tools in the toolbar of 3D views."""

    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_cursor = "CROSSHAIR"
    bl_keymap = ()


def _keymap_of(tool: str) -> str:
    """As Blender names the keymaps of tools."""
    return f"3D View Tool: Object, {TOOLS[tool]}"


@dataclass(frozen=True)
class Place:
    """A keymap: of a tool, or of an editor, whose other keys stay what they are.

    ``name`` and ``space_type`` are Blender's; ``is_tool``: of a tool.
    """

    name: str
    space_type: Any  # one of Blender's names
    is_tool: bool = False

    def keymap(self, configuration: bpy.types.KeyConfig) -> bpy.types.KeyMap:
        """The keymap, made if there is none."""
        # editors' own are not bound to a region
        region: Any = {"region_type": "WINDOW", "tool": True} if self.is_tool else {}
        return configuration.keymaps.new(name=self.name, space_type=self.space_type, **region)


def place_of(tool: str) -> Place:
    """The keymap of a tool."""
    return Place(_keymap_of(tool), "VIEW_3D", is_tool=True)


def active_tool(context: bpy.types.Context) -> str:
    """The active tool in Object mode; empty in other modes."""
    if context.mode != "OBJECT" or context.workspace is None:
        return ""
    tool = context.workspace.tools.from_space_view3d_mode("OBJECT", create=False)
    return "" if tool is None else tool.idname


@dataclass(frozen=True)
class Key:
    """One key of one operator.

    Attributes
    ----------
    operator
        Its ``bl_idname``. Where its poll fails, Blender uses the next binding of the key.
    type, value, shift, ctrl, alt, repeat
        As in Blender's keymap items.
    properties
        The operator's settings: names and values.
    tools
        The tools that have the key.
    places
        Other keymaps that have it; its operator passes the key on where there is nothing for it to do.
    """

    operator: str
    type: Any  # one of Blender's names
    value: Any = "PRESS"
    shift: bool = False
    ctrl: bool = False
    alt: bool = False
    repeat: bool = False
    properties: tuple[tuple[str, object], ...] = ()
    tools: tuple[str, ...] = ALIGNMENT_TOOLS
    places: tuple[Place, ...] = ()


def keys(*given: Key) -> Part:
    """The keys of a module, in the add-on key configuration, where there is one."""
    added: list[tuple[bpy.types.KeyMap, bpy.types.KeyMapItem]] = []

    def add() -> None:
        configuration = bpy.context.window_manager.keyconfigs.addon
        if configuration is None:
            return
        for key in given:
            for place in (*map(place_of, key.tools), *key.places):
                keymap = place.keymap(configuration)
                item = keymap.keymap_items.new(
                    key.operator, key.type, key.value, shift=key.shift, ctrl=key.ctrl, alt=key.alt, repeat=key.repeat
                )
                for setting, value in key.properties:
                    setattr(item.properties, setting, value)
                added.append((keymap, item))

    def remove() -> None:
        for keymap, item in added:
            keymap.keymap_items.remove(item)
        added.clear()

    return Part(add, remove)


def binding(operator: str, **properties: object) -> str:
    """The key that would now call an operator with these settings, as text; empty if none would.

    That is one of the active tool, while the operator is available.
    """
    manager, tool = bpy.context.window_manager, active_tool(bpy.context)
    room, _, name = operator.partition(".")
    if tool not in TOOLS or not getattr(getattr(bpy.ops, room), name).poll():
        return ""
    for configuration in (manager.keyconfigs.user, manager.keyconfigs.addon):
        if configuration is None:
            continue
        for item in _items(configuration, _keymap_of(tool)):
            if item.idname != operator or not item.active or item.type == "NONE":
                continue
            if all(getattr(item.properties, key, None) == value for key, value in properties.items()):
                return item.to_string()
    return ""


def draw_key(layout: bpy.types.UILayout, operator: str, **properties: object) -> None:
    """Show the key of an operator next to its button, greyed out; nothing if none would call it now."""
    row = layout.row()
    row.enabled = False
    row.label(text=binding(operator, **properties))


def _items(configuration: bpy.types.KeyConfig, name: str) -> Iterable[bpy.types.KeyMapItem]:
    keymap = configuration.keymaps.get(name)
    return () if keymap is None else keymap.keymap_items
