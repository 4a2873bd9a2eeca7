"""The triangle mesh.

In: PLY, OBJ or STL files. Out: :class:`~.mesh.TriangleMesh`, and files for other programs.
"""
