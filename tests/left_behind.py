"""What an add-on has placed in a running Blender, and whether all of it is gone when the add-on is.

Imported by the test scripts that run inside a Blender; in the module and in the program alike.
"""

import gc
import sys
import types
import weakref
from collections.abc import Iterator

import bpy


def registered() -> dict[str, list[str]]:
    """All that can be listed: classes, operators, properties of data-blocks, handlers and keys of add-ons."""
    data_blocks = [kind for name in dir(bpy.types) if _is_data_block(kind := getattr(bpy.types, name))]
    handlers = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    keymaps = bpy.context.window_manager.keyconfigs.addon.keymaps
    return {
        "classes": sorted(dir(bpy.types)),
        "operators": sorted(f"{group}.{name}" for group in dir(bpy.ops) for name in dir(getattr(bpy.ops, group))),
        "properties": sorted(f"{kind.__name__}.{name}" for kind in data_blocks for name in dir(kind)),
        "handlers": sorted(f"{name} {h}" for name, some in handlers.items() if isinstance(some, list) for h in some),
        "keys": sorted(f"{keymap.name}: {item.idname}" for keymap in keymaps for item in keymap.keymap_items),
    }


def _is_data_block(kind: type) -> bool:
    return isinstance(kind, type) and issubclass(kind, bpy.types.ID)


def only_in(found: dict[str, list[str]], other: dict[str, list[str]]) -> dict[str, list[str]]:
    """What the first has and the second has not; topics without any are left out."""
    differences = {topic: sorted(set(found[topic]) - set(other[topic])) for topic in found}
    return {topic: names for topic, names in differences.items() if names}


class Code:
    """An add-on's functions and classes, without keeping them alive.

    Timers, draw handlers and subscriptions to the message bus cannot be listed, but they hold functions. So when the
    add-on is disabled and forgotten by the module table, nothing of it may be left in memory.
    """

    def __init__(self, package: str) -> None:
        self.package = package
        self._defined = {name: weakref.ref(thing) for name, thing in self._definitions()}

    def _modules(self) -> list[str]:
        return [name for name in sys.modules if name == self.package or name.startswith(f"{self.package}.")]

    def _definitions(self) -> Iterator[tuple[str, object]]:
        for module in self._modules():
            for name, thing in vars(sys.modules[module]).items():
                if isinstance(thing, types.FunctionType | type) and thing.__module__ == module:
                    yield f"{module}.{name}", thing

    def still_held(self) -> list[str]:
        """Forget the modules; names of the functions and classes that something else keeps alive."""
        parent, _, name = self.package.rpartition(".")
        vars(sys.modules[parent]).pop(name, None)
        for module in self._modules():
            del sys.modules[module]
        gc.collect()
        return [name for name, reference in self._defined.items() if reference() is not None]
