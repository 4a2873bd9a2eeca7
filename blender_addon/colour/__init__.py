"""Panel *Colour*: project the frame's colours on the surface, and export it."""
