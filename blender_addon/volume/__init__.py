"""Panel *CT*: open a CT, look at its slices, make the surface of its bone, drill it."""
