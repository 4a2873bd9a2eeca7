"""The stages that need Blender: the only code below the add-on that imports bpy.

The same topics as beside it, and ``bridge``, where arrays become data-blocks.
"""
