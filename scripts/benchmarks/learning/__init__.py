"""A small network that learns poses from nothing but the views of a dataset."""
