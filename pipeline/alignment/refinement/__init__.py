"""The pose from the image itself.

In: a rough pose, the frame, the surface. Out: a refined and verified pose, or the reason for refusing it.
"""
