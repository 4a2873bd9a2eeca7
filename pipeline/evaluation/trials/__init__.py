"""In: cases, cameras, a random generator. Out: measured errors and times of one method beside its peers'."""
