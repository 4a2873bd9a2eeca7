"""A mesh as a camera sees it.

In: a mesh, a camera, a pose. Out: depth, silhouette, edges, in pixels.
"""
