"""The poses of other frames, found by what the aligned frame shows of the surface.

In: the aligned frame, the surface, other frames of the same camera. Out: a pose of each of them, how far to trust it,
and why. Needs ``cv2``.
"""
