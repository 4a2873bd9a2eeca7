"""Keyboard shortcuts: registered in the add-on key configuration, and shown in panels as currently bound."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy

VIEW = "3D View"
OBJECT_MODE = "Object Mode"
"""Blender searches this keymap before the 3D view's own. Plain letters and digits belong here: they then do nothing in
Edit mode."""

_SPACES: dict[str, Any] = {VIEW: "VIEW_3D", OBJECT_MODE: "EMPTY"}


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
    keymap
        :data:`VIEW` or :data:`OBJECT_MODE`.
    """

    operator: str
    type: Any  # one of Blender's names
    value: Any = "PRESS"
    shift: bool = False
    ctrl: bool = False
    alt: bool = False
    repeat: bool = False
    properties: tuple[tuple[str, object], ...] = ()
    keymap: str = VIEW


class Keys:
    """The keys of a module: :meth:`register` adds them, :meth:`unregister` removes them."""

    def __init__(self, keys: Iterable[Key]) -> None:
        self.keys = tuple(keys)
        self._added: list[tuple[bpy.types.KeyMap, bpy.types.KeyMapItem]] = []

    def register(self) -> None:
        """Add the keys to the add-on key configuration, where there is one."""
        configuration = bpy.context.window_manager.keyconfigs.addon
        if configuration is None:
            return
        for key in self.keys:
            keymap = configuration.keymaps.new(name=key.keymap, space_type=_SPACES[key.keymap])
            item = keymap.keymap_items.new(
                key.operator, key.type, key.value, shift=key.shift, ctrl=key.ctrl, alt=key.alt, repeat=key.repeat
            )
            for name, value in key.properties:
                setattr(item.properties, name, value)
            self._added.append((keymap, item))

    def unregister(self) -> None:
        """Remove the keys."""
        for keymap, item in self._added:
            keymap.keymap_items.remove(item)
        self._added.clear()


def binding(operator: str, **properties: object) -> str:
    """The key currently bound to an operator with these settings, as text; empty if there is none."""
    manager = bpy.context.window_manager
    for configuration in (manager.keyconfigs.user, manager.keyconfigs.addon):
        if configuration is None:
            continue
        for name in (OBJECT_MODE, VIEW):
            for item in _items(configuration, name):
                if item.idname != operator or not item.active or item.type == "NONE":
                    continue
                if all(getattr(item.properties, key, None) == value for key, value in properties.items()):
                    return item.to_string()
    return ""


def draw_key(layout: bpy.types.UILayout, operator: str, **properties: object) -> None:
    """Show the key of an operator next to its button, greyed out; nothing if it has none."""
    row = layout.row()
    row.enabled = False
    row.label(text=binding(operator, **properties))


def _items(configuration: bpy.types.KeyConfig, name: str) -> Iterable[bpy.types.KeyMapItem]:
    keymap = configuration.keymaps.get(name)
    return () if keymap is None else keymap.keymap_items
