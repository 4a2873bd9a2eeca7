"""Panel *Refine*: the pose from the image itself."""
