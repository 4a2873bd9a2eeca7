"""The light of a frame: where it comes from, what it reaches, and images without it.

In: a surface and an image, or several frames. Out: a direction and the shadows that it casts, images less their local
mean, and frames in one exposure. A lamp that moves with the lens belongs here.
"""
