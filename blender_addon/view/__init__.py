"""Panel *View*: surface and frame, seen against each other."""
