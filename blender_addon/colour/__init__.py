"""Panel *Colour*: the frame's colours on the surface, and files of it."""
