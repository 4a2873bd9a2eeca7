"""A plugin of mypy: what the stubs of bpy (fake-bpy-module) cannot know, or declare too widely.

The stubs are generated from Blender's documentation. That a pointer is never empty is not in it, so all pointers there
may be ``None``; and the properties that the add-on hangs on Blender's own types are the add-on's.
"""

from collections.abc import Callable
from functools import partial

from mypy.nodes import MypyFile, TypeInfo
from mypy.plugin import AttributeContext, ClassDefContext, Plugin
from mypy.plugins.common import add_attribute_to_class
from mypy.types import AnyType, Instance, NoneType, Type, TypeOfAny, UnionType, get_proper_type

NEVER_NONE = frozenset(
    f"bpy.types.{name}"
    for name in (
        # the add-on's callbacks run in a window with a scene
        "Context.preferences",
        "Context.scene",
        "Context.window_manager",
        "Context.workspace",
        "Panel.layout",
        # parts that their owners always have
        "Image.colorspace_settings",
        "Preferences.system",
        "RenderSettings.ffmpeg",
        "Scene.display",
        "Scene.eevee",
        "Scene.view_settings",
        "SpaceView3D.overlay",
        "SpaceView3D.region_3d",
        "SpaceView3D.shading",
    )
)
"""Attributes that are not None although the stubs say that they may be."""

ANY = frozenset({"bpy.types.Object.data"})
"""Attributes whose stub is a union that no caller can narrow: which one it is follows from the object's type."""

ADDED = {
    "bpy.types.Object": {"oneframe": "blender_addon.state.properties.ONEFRAME_PG_object"},
    "bpy.types.Scene": {
        "oneframe": "blender_addon.state.properties.ONEFRAME_PG_scene",
        "oneframe_view": "blender_addon.view.operators.ONEFRAME_PG_view",
    },
}
"""Blender's types -> the properties that the add-on gives them -> the types of these."""


class BlenderPlugin(Plugin):
    """Corrects the types of some attributes of bpy's types."""

    def get_attribute_hook(self, fullname: str) -> Callable[[AttributeContext], Type] | None:
        """Called by mypy for every attribute that is read."""
        if fullname in NEVER_NONE:
            return _without_none
        if fullname in ANY:
            return lambda _: AnyType(TypeOfAny.explicit)
        owner, _, name = fullname.rpartition(".")
        if name in ADDED.get(owner, {}):
            return partial(_of_class, ADDED[owner][name])
        return None

    def get_customize_class_mro_hook(self, fullname: str) -> Callable[[ClassDefContext], None] | None:
        """Called by mypy for every class."""
        return _add_attributes if fullname in ADDED else None

    def get_additional_deps(self, file: MypyFile) -> list[tuple[int, str, int]]:
        """Called by mypy for every module: the add-on's see the classes in ``ADDED``."""
        if not file.fullname.startswith("blender_addon."):
            return []
        modules = {target.rpartition(".")[0] for added in ADDED.values() for target in added.values()}
        return [(10, module, -1) for module in sorted(modules - {file.fullname})]


def _without_none(context: AttributeContext) -> Type:
    found = get_proper_type(context.default_attr_type)
    if not isinstance(found, UnionType):
        return found
    return UnionType.make_union([part for part in found.items if not isinstance(get_proper_type(part), NoneType)])


def _of_class(target: str, context: AttributeContext) -> Type:
    module, _, name = target.rpartition(".")
    # outside the add-on these classes may not be loaded
    tree = context.api.modules.get(module)  # type: ignore[attr-defined]  # the checker has it, its interface does not
    node = tree.names[name].node if tree is not None and name in tree.names else None
    return Instance(node, []) if isinstance(node, TypeInfo) else context.default_attr_type


def _add_attributes(context: ClassDefContext) -> None:
    for name in ADDED[context.cls.fullname]:
        if name not in context.cls.info.names:
            add_attribute_to_class(context.api, context.cls, name, AnyType(TypeOfAny.explicit))


def plugin(_version: str) -> type[Plugin]:
    """Called by mypy."""
    return BlenderPlugin
