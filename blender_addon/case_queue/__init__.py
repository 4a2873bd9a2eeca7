"""Panel *Queue*: many frames of one surface, one after the other."""
