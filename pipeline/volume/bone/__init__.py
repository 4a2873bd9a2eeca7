"""Bone and structures of a volume, and their surfaces.

In: a volume, its labels, a field of what is removed. Out: voxels of bone, and triangle meshes.
"""
