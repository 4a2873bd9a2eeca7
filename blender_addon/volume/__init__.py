"""Panel *CT*: open a CT and its labels, make the surface of its bone."""
