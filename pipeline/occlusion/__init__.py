"""What stands in front of the surface in a view: where it is held, and the view with it."""
