"""Panel *View*: compare surface and frame in the camera view."""
