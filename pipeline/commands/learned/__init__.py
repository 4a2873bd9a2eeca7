"""The commands of a network that views teach: its training, and frames found with it."""
