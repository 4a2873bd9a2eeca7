"""Panel *Landmarks*: the pose from pairs of points, and how sure it is."""
