"""Colouring the surface by ray casting from the frame.

In: a case at its pose. Out: a coloured surface, its coverage by the frame, and files of it.
"""
