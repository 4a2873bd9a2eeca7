"""Slices through a volume.

In: a volume and a point. Out: planes, and their pictures.
"""
