"""The pose from the image itself.

In: a rough pose, the frame, the surface. Out: a better pose, verified, or the reason why there is none.
"""
