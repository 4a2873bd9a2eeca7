"""Short calls to build node trees; shaders and Geometry Nodes share most of their nodes."""

import bpy


class Nodes:
    """Adds nodes to a tree and links them."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self._tree = tree

    def add(self, kind: str, **settings: object) -> bpy.types.Node:
        """Add a node; ``settings`` are default values of its inputs or, for other names, its properties."""
        node = self._tree.nodes.new(kind)
        for name, value in settings.items():
            if name in node.inputs:
                node.inputs[name].default_value = value
            else:
                setattr(node, name, value)
        return node

    def link(self, output: bpy.types.NodeSocket, to: bpy.types.NodeSocket) -> None:
        """Connect two sockets."""
        self._tree.links.new(output, to)

    def math(self, operation: str, *values: float | bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """The result of a math operation on numbers and sockets."""
        node = self.add("ShaderNodeMath", operation=operation)
        for socket, value in zip(node.inputs, values, strict=False):
            if isinstance(value, int | float):
                socket.default_value = value
            else:
                self.link(value, socket)
        return node.outputs[0]

    def dot(self, vector: bpy.types.NodeSocket, other: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """The scalar product of two vectors."""
        node = self.add("ShaderNodeVectorMath", operation="DOT_PRODUCT")
        self.link(vector, node.inputs[0])
        self.link(other, node.inputs[1])
        return node.outputs["Value"]

    def scaled(self, vector: bpy.types.NodeSocket, factor: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """A vector times a number."""
        node = self.add("ShaderNodeVectorMath", operation="SCALE")
        self.link(vector, node.inputs[0])
        self.link(factor, node.inputs["Scale"])
        return node.outputs["Vector"]

    def mixed(
        self, factor: bpy.types.NodeSocket, zero: tuple | bpy.types.NodeSocket, one: bpy.types.NodeSocket
    ) -> bpy.types.NodeSocket:
        """The colour ``zero`` (RGBA or a socket) where the factor is 0, and ``one`` where it is 1."""
        node = self.add("ShaderNodeMix", data_type="RGBA")
        self.link(factor, node.inputs[0])
        if isinstance(zero, tuple):
            node.inputs[6].default_value = zero
        else:
            self.link(zero, node.inputs[6])
        self.link(one, node.inputs[7])
        return node.outputs[2]
