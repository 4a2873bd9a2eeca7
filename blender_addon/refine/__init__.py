"""Panel *Refine*: refine the pose against the image."""
