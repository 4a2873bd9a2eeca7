"""The virtual drill.

In: strokes of burrs and margins around structures. Out: the field of what they remove, and how near they come.
"""
