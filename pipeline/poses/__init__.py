"""New camera poses.

In: the frame's pose, a seed, an index. Out: the pose of that view, within constraints.
"""
