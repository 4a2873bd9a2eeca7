"""The figures of all topics as pictures, by matplotlib."""
