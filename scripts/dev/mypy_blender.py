"""A plugin of mypy: what the stubs of bpy (fake-bpy-module) cannot know, or declare too widely.

The stubs are generated from Blender's documentation. That a pointer is never empty is not in it, so all pointers there
may be ``None``; and the properties that the add-on hangs on Blender's own types are the add-on's.
"""

from collections.abc import Callable
from functools import partial

from mypy.nodes import Decorator, FuncDef, MypyFile, TypeInfo
from mypy.plugin import AttributeContext, ClassDefContext, Plugin
from mypy.plugins.common import add_attribute_to_class
from mypy.types import (
    AnyType,
    CallableType,
    Instance,
    NoneType,
    Type,
    TypeOfAny,
    UnboundType,
    UnionType,
    get_proper_type,
)

NEVER_NONE = frozenset(
    f"bpy.types.{name}"
    for name in (
        # the add-on's callbacks run in a window with a scene
        "Context.preferences",
        "Context.region",
        "Context.scene",
        "Context.screen",
        "Context.window_manager",
        "Context.workspace",
        "Panel.layout",
        # parts that their owners always have
        "Image.colorspace_settings",
        "Material.node_tree",
        "NodeTree.interface",
        "Preferences.system",
        "RenderSettings.ffmpeg",
        "Scene.display",
        "Scene.eevee",
        "Scene.view_settings",
        "SceneDisplay.shading",
        "SpaceView3D.overlay",
        "SpaceView3D.region_3d",
        "SpaceView3D.shading",
        "Window.screen",
    )
)
"""Attributes that are not None although the stubs say that they may be."""

ANY = frozenset(
    f"bpy.types.{name}" for name in ("Object.data", "Scene.cycles", "Context.space_data", "AreaSpaces.active")
)
"""Attributes whose type follows from what the stubs do not know: the object's type, the area's, the engines in use."""

KINDS = frozenset(f"bpy.types.{name}" for name in ("Attribute", "Node", "NodeSocket", "Space"))
"""Types of which Blender returns the subclass that a name in the call stands for, and the stubs the base class."""

CALLBACK_ARGUMENTS = frozenset({"context", "event"})
"""What Blender gives every callback, never None."""

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
        return _correct if fullname.startswith("bpy.types.") else None

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


def _correct(context: ClassDefContext) -> None:
    owner = context.cls
    for name in ADDED.get(owner.fullname, ()):
        if name not in owner.info.names:
            add_attribute_to_class(context.api, owner, name, AnyType(TypeOfAny.explicit))
    if owner.fullname in KINDS:
        owner.info.fallback_to_any = True
    for member in owner.defs.body:
        function = member.func if isinstance(member, Decorator) else member
        if isinstance(function, FuncDef):
            for signature in (function.type, function.unanalyzed_type):
                if isinstance(signature, CallableType):
                    signature.arg_types = [
                        _unless_none(kind) if name in CALLBACK_ARGUMENTS else kind
                        for name, kind in zip(signature.arg_names, signature.arg_types, strict=True)
                    ]


def _unless_none(written: Type) -> Type:
    """Of a type as the stub spells it, before mypy knows what its names stand for."""
    if not isinstance(written, UnionType):
        return written
    return UnionType.make_union(
        [part for part in written.items if not (isinstance(part, UnboundType) and part.name == "None")]
    )


def plugin(_version: str) -> type[Plugin]:
    """Called by mypy."""
    return BlenderPlugin
