"""From numpy to bpy and back.

In: arrays, cameras, meshes. Out: data-blocks with exactly these values.
"""
