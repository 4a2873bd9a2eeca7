"""Short calls to build node trees; shaders and Geometry Nodes share most of their nodes."""

from collections.abc import Mapping
from typing import Any

import bpy


class Nodes:
    """Adds nodes to a tree and links them."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self._tree = tree

    def add(self, kind: str, given: Mapping[Any, Any] | None = None, **settings: object) -> bpy.types.Node:
        """Add a node.

        ``given`` are numbers, colours or sockets for its inputs, by their names or numbers; ``settings`` default values
        of its inputs or, for other names, its properties.
        """
        node = self._tree.nodes.new(kind)
        for name, value in settings.items():
            if name in node.inputs:
                node.inputs[name].default_value = value
            else:
                setattr(node, name, value)
        for key, value in (given or {}).items():
            if isinstance(value, bpy.types.NodeSocket):
                self.link(value, node.inputs[key])
            else:
                node.inputs[key].default_value = value
        return node

    def link(self, output: bpy.types.NodeSocket, to: bpy.types.NodeSocket) -> None:
        """Connect two sockets."""
        self._tree.links.new(output, to)

    def math(self, operation: str, *values: float | bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """The result of a math operation on numbers and sockets."""
        return self.add("ShaderNodeMath", dict(enumerate(values)), operation=operation).outputs[0]

    def added(self, *vectors: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """The sum of vectors or colours."""
        total, *others = vectors
        for other in others:
            total = self.add("ShaderNodeVectorMath", {0: total, 1: other}, operation="ADD").outputs["Vector"]
        return total

    def scaled(self, vector: bpy.types.NodeSocket, factor: float | bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """A vector times a number."""
        return self.add("ShaderNodeVectorMath", {0: vector, "Scale": factor}, operation="SCALE").outputs["Vector"]

    def chosen(
        self, flag: bpy.types.NodeSocket, zero: bpy.types.NodeSocket, one: float | bpy.types.NodeSocket
    ) -> bpy.types.NodeSocket:
        """The number ``zero`` where the flag is 0, and ``one`` where it is 1."""
        return self.math("MULTIPLY_ADD", flag, self.math("SUBTRACT", one, zero), zero)

    def mixed(self, factor: bpy.types.NodeSocket, zero: Any, one: Any) -> bpy.types.NodeSocket:
        """The colour ``zero`` (RGBA or a socket) where the factor is 0, and ``one`` where it is 1."""
        return self.add("ShaderNodeMix", {0: factor, 6: zero, 7: one}, data_type="RGBA").outputs[2]
