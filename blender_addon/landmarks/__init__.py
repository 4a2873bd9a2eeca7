"""Panel *Pin*: the pose from 2D-3D correspondences, and its uncertainty."""
