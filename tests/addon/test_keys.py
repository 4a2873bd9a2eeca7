"""The keys of the add-on's tools beside Blender's own, and the hints that show them."""

import sys
from itertools import combinations
from pathlib import Path

import bpy
import pytest

MOUSE = {"LEFTMOUSE", "RIGHTMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "WHEELINMOUSE", "WHEELOUTMOUSE"}
WHOLE_PROGRAM = {"Window", "Screen"}
IN_VIEW = {"3D View", "3D View Generic", "Object Mode", "Object Non-modal", "Frames"}
OF_OTHER_EDITORS = {"file.execute", "file.cancel", "render.view_cancel"}
"""In the keymap Screen, for file browsers and renders, which no 3D view shows."""


@pytest.fixture(scope="module")
def blenders() -> list[tuple[str, str, dict]]:
    """Keymap, operator and chord of each default key: Blender in background has keymaps, but no keys in them."""
    folder = Path(bpy.utils.system_resource("SCRIPTS")) / "presets" / "keyconfig"
    sys.path.insert(0, str(folder))
    try:
        from keymap_data import blender_default
    finally:
        sys.path.remove(str(folder))
    found = blender_default.generate_keymaps(blender_default.Params())
    return [(name, item[0], item[1]) for name, _, content in found for item in content["items"]]


def own_keys() -> list[tuple[str, bpy.types.KeyMapItem]]:
    """Keymap and key of the add-on's own in 3D views."""
    keymaps = bpy.context.window_manager.keyconfigs.addon.keymaps
    return [(each.name, key) for each in keymaps if each.name.startswith("3D View") for key in each.keymap_items]


def chord(key: bpy.types.KeyMapItem) -> tuple[str, int, int, int]:
    return key.type, key.shift, key.ctrl, key.alt


def is_same(key: bpy.types.KeyMapItem, other: dict) -> bool:
    """Whether a press for our key reaches Blender's."""
    if other["type"] != key.type or other["value"] == "RELEASE" or other.get("key_modifier"):
        return False
    held = {name: other.get(name, 0) for name in ("shift", "ctrl", "alt")}
    return bool(other.get("any")) or all(
        value == -1 or bool(value) == bool(getattr(key, name)) for name, value in held.items()
    )


def test_no_key_takes_one_of_the_whole_program_or_with_ctrl(addon, blenders):
    """Other keys act on the surface in the add-on's tools, where Blender's would move or hide it."""
    assert {name for name, _, _ in blenders} >= WHOLE_PROGRAM | IN_VIEW
    own = [(keymap, key) for keymap, key in own_keys() if keymap != "3D View"]
    taken = [
        (keymap, key.to_string(), key.idname, name, operator)
        for keymap, key in own
        for name, operator, other in blenders
        if name in WHOLE_PROGRAM and operator not in OF_OTHER_EDITORS and is_same(key, other)
    ]
    assert not taken
    assert not [key.to_string() for _, key in own if key.ctrl and key.type not in MOUSE]


def test_no_key_means_two_things(addon):
    keys = own_keys()
    assert len(keys) > 100
    twice = [
        (keymap, key.to_string(), key.idname, other.idname)
        for (keymap, key), (other_keymap, other) in combinations(keys, 2)
        if keymap == other_keymap and chord(key) == chord(other)
    ]
    assert not twice


def test_keys_of_other_tools_and_editors_stay_blenders(addon):
    """Keys lie in the own tools, or belong to operators that pass them on where there is nothing for them to do."""
    own = {f"3D View Tool: Object, {tool}" for tool in ("Pins", "Landmarks", "Move Surface")}
    for keymap in bpy.context.window_manager.keyconfigs.addon.keymaps:
        for item in keymap.keymap_items:
            room, _, name = item.idname.partition(".")
            if room == "oneframe" and keymap.name not in own:
                assert not getattr(bpy.ops.oneframe, name).poll(), (keymap.name, item.idname)
