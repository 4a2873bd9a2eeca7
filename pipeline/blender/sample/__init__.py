"""The photographs of the built-in case.

In: the sample surface. Out: a case folder with a frame and held-out photographs.
"""
