"""What the frame saw, on the surface.

In: a frame at its pose. Out: the colours of vertices or of a texture, and which of them were observed.
"""
