"""From a volume to a surface.

In: a CT and a map of labels, as files. Out: the surface of the bone, drilled, and of the structures in it, as triangle
meshes in the CT's LPS millimetres.
"""
