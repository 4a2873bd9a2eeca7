"""Posing by hand.

In: a pose and a gesture. Out: the pose after it.
"""
