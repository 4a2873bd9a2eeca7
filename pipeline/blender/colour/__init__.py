"""Colouring the surface by ray casting from the frame.

In: a case at its pose. Out: a coloured surface, how much of it is covered, and files of it.
"""
