"""What of the frame shows no surface: a first guess, a brush, a file."""
