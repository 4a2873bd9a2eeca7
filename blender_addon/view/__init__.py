"""Panel *View*: surface and frame in the camera view."""
