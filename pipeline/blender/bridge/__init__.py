"""From numpy to bpy and back.

In: arrays, cameras, meshes. Out: data-blocks that hold exactly these.
"""
