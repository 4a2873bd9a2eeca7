"""Panel *Colour*: project the frame's colours on the surface."""
