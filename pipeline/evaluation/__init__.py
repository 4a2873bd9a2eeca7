"""How good it is.

In: synthetic views and photographs, poses and the truth. Out: figures.
"""
