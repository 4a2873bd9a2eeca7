"""A plugin of mypy: what the stubs of Blender's modules (fake-bpy-module) cannot know, or get wrong.

The stubs are generated from Blender's documentation. It does not say which pointers are never empty, so that all may be
``None``: here none is when it is read. Nor does it say what a name in a call stands for (a kind of node, an enumeration
that is made at runtime), or that a sequence of numbers may be a numpy array. And the properties that the add-on hangs
on Blender's types are the add-on's.
"""

from collections.abc import Callable
from functools import partial

from mypy.nodes import Decorator, FuncDef, MypyFile, TypeInfo
from mypy.plugin import AttributeContext, ClassDefContext, FunctionSigContext, MethodSigContext, Plugin
from mypy.plugins.common import add_attribute_to_class
from mypy.types import (
    AnyType,
    CallableType,
    FunctionLike,
    Instance,
    LiteralType,
    NoneType,
    Type,
    TypeOfAny,
    UnboundType,
    UnionType,
    get_proper_type,
)

ANY = frozenset(
    f"bpy.types.{name}"
    for name in (
        # which type follows from the object's, the area's, or the owner's
        "AreaSpaces.active",
        "Context.space_data",
        "Image.pixels",
        "ImagePreview.image_pixels_float",
        "Object.data",
        "RenderPass.rect",
        "bpy_struct.id_data",
        # from Cycles, an add-on of Blender
        "Light.cycles",
        "Material.cycles",
        "Scene.cycles",
        "World.cycles",
    )
)
"""Attributes whose type the stubs cannot know."""

KINDS = frozenset(
    f"bpy.types.{name}"
    for name in ("Attribute", "Gizmo", "Light", "Modifier", "Node", "NodeSocket", "Property", "Space", "Strip")
)
"""Base classes in the stubs where Blender returns the subclass that a name in the call stands for."""

CALLBACKS = frozenset(
    {
        *("poll", "invoke", "modal", "execute", "check", "cancel"),
        *("draw", "draw_header_preset", "draw_item"),
        *("setup", "draw_prepare", "test_select", "exit"),
    }
)
"""Methods that Blender calls: none of their arguments is None."""

MISSING = {
    "bpy.types.bpy_struct": ("__contains__",),
    "bpy.types.ContextTempOverride": ("__enter__", "__exit__"),
    "mathutils.Matrix": ("__iter__",),
    "mathutils.Vector": ("__iter__",),
}
"""What is missing in the stubs."""

LOOSE_FUNCTIONS = ("bpy.props.", "bpy.types.bpy_prop_array.", "bpy.utils.", "mathutils.")
"""Functions that take a numpy array where their stubs want a sequence, and whose results the stubs of 4.5 leave out."""

ADDED = {
    "bpy.types.Object": {"oneframe": "blender_addon.state.properties.ONEFRAME_PG_object"},
    "bpy.types.Scene": {
        "oneframe": "blender_addon.state.properties.ONEFRAME_PG_scene",
        "oneframe_view": "blender_addon.view.operators.ONEFRAME_PG_view",
        "oneframe_ct": "blender_addon.volume.ct.ONEFRAME_PG_ct",
        "oneframe_video": "blender_addon.video.session.ONEFRAME_PG_video",
    },
}
"""Blender's types -> the properties that the add-on gives them -> the types of these."""

_ANYTHING = AnyType(TypeOfAny.explicit)


class BlenderPlugin(Plugin):
    """Corrects the stubs where the add-on and ``pipeline.blender`` use them."""

    def get_attribute_hook(self, fullname: str) -> Callable[[AttributeContext], Type] | None:
        """Called by mypy for every attribute that is read or set."""
        if not fullname.startswith("bpy.types."):
            return None
        owner, _, name = fullname.rpartition(".")
        if name in ADDED.get(owner, {}):
            return partial(_of_class, ADDED[owner][name])
        return partial(_attribute, fullname)

    def get_function_signature_hook(self, fullname: str) -> Callable[[FunctionSigContext], FunctionLike] | None:
        """Called by mypy for every call of a function or a class."""
        return _loosened if fullname.startswith(LOOSE_FUNCTIONS) else None

    def get_method_signature_hook(self, fullname: str) -> Callable[[MethodSigContext], FunctionLike] | None:
        """Called by mypy for every call of a method."""
        # operators are overloaded by what they take: Matrix @ Vector
        return _loosened if fullname.startswith(LOOSE_FUNCTIONS) and not fullname.endswith("__") else None

    def get_customize_class_mro_hook(self, fullname: str) -> Callable[[ClassDefContext], None] | None:
        """Called by mypy for every class."""
        return _correct if fullname.startswith(("bpy.types.", "mathutils.")) else None

    def get_additional_deps(self, file: MypyFile) -> list[tuple[int, str, int]]:
        """Called by mypy for every module: the add-on's see the classes in ``ADDED``."""
        if not file.fullname.startswith("blender_addon."):
            return []
        modules = {target.rpartition(".")[0] for added in ADDED.values() for target in added.values()}
        return [(10, module, -1) for module in sorted(modules - {file.fullname})]


def _attribute(fullname: str, context: AttributeContext) -> Type:
    found = get_proper_type(context.default_attr_type)
    if fullname in ANY:
        return _ANYTHING
    if isinstance(found, UnionType) and not context.is_lvalue:
        return UnionType.make_union([part for part in found.items if not isinstance(get_proper_type(part), NoneType)])
    if isinstance(found, Instance) and found.type.name == "bpy_prop_array":
        # the stub knows no item of it, and that a tuple may be assigned
        return _ANYTHING
    if isinstance(found, LiteralType):
        # an enumeration that is made at runtime: the stub knows its first item only
        return found.fallback
    return found


def _of_class(target: str, context: AttributeContext) -> Type:
    module, _, name = target.rpartition(".")
    # outside the add-on these classes may not be loaded
    tree = context.api.modules.get(module)  # type: ignore[attr-defined]  # the checker has it, its interface does not
    node = tree.names[name].node if tree is not None and name in tree.names else None
    return Instance(node, []) if isinstance(node, TypeInfo) else context.default_attr_type


def _loosened(context: FunctionSigContext | MethodSigContext) -> FunctionLike:
    signature = context.default_signature
    kinds = [_ANYTHING if "Sequence[" in str(kind) else kind for kind in signature.arg_types]
    unknown = isinstance(get_proper_type(signature.ret_type), NoneType)
    return signature.copy_modified(arg_types=kinds, ret_type=_ANYTHING if unknown else signature.ret_type)


def _correct(context: ClassDefContext) -> None:
    owner = context.cls
    for name in (*ADDED.get(owner.fullname, ()), *MISSING.get(owner.fullname, ())):
        if name not in owner.info.names:
            add_attribute_to_class(context.api, owner, name, _ANYTHING)
    if owner.fullname in KINDS:
        owner.info.fallback_to_any = True
    for member in owner.defs.body:
        function = member.func if isinstance(member, Decorator) else member
        if isinstance(function, FuncDef):
            for signature in (function.type, function.unanalyzed_type):
                if isinstance(signature, CallableType):
                    _correct_signature(f"{owner.fullname}.{function.name}", signature)


def _correct_signature(fullname: str, signature: CallableType) -> None:
    """Correct the types of a method, as the stub spells it: mypy does not know yet what its names stand for."""
    kinds: list[Type] = []
    name_of_method = fullname.rpartition(".")[2]
    for name, kind in zip(signature.arg_names, signature.arg_types, strict=True):
        if name_of_method in CALLBACKS and isinstance(kind, UnionType):
            named = [part for part in kind.items if not (isinstance(part, UnboundType) and part.name == "None")]
            kinds.append(UnionType.make_union(named))
        elif name == "icon" and fullname.startswith("bpy.types.UILayout."):
            # the add-on chooses icons at runtime
            kinds.append(_ANYTHING)
        else:
            kinds.append(kind)
    signature.arg_types = kinds


def plugin(_version: str) -> type[Plugin]:
    """Called by mypy."""
    return BlenderPlugin
