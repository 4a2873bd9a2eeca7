"""Panel *Dataset*: poses, a preview, and the run in the background."""
