"""The folder of a run: locks, what a killed run left, and the records by which it resumes."""
