"""The stages that need Blender: the only code below the add-on that imports bpy.

The same topics as in the rest of the pipeline, and ``bridge``, where arrays become data-blocks.
"""
