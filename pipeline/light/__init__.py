"""The light of a frame: where it comes from, and images without it.

In: a surface and an image, or several frames. Out: the lamp at the lens, which moves with it, and what it gives a
surface, images less their local mean, and frames in one exposure.
"""
