"""Panel *Frames*: the other frames of the surface, those of a queue and those of the film, whose poses are found."""
