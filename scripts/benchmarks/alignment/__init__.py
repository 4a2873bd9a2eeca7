"""Poses from landmarks and from the image itself: trials with known truth, beside other solvers."""
