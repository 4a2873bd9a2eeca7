"""What stands in front of the surface in a view: instruments, where they are held, and the view with them."""
