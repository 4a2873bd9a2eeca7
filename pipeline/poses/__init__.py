"""New camera poses.

In: the frame's pose, a seed, the index of a view. Out: the pose of that view, which meets the constraints.
"""
