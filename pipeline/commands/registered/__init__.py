"""What registered frames tell of their case: the lamp at the lens."""
