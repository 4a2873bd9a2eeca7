"""Panel *Frames*: the other frames of the film find their poses, correct the first one, and colour the surface."""
