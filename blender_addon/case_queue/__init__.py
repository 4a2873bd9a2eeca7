"""In panel *Frames*: many frames of one surface, one after the other."""
