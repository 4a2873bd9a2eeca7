"""A network that views of a case teach where a frame shows which point of the surface; its poses start registration."""
