"""Change the pose by keys, and by drags of the tool *Move Surface*."""
