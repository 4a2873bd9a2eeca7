"""From a volume to a surface.

In: a signed distance field on a grid, negative in air. Out: the surface of the bone as a triangle mesh.
"""
