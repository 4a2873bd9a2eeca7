"""Charts of what was measured, drawn by matplotlib, which is optional: ``pip install matplotlib``.

In: the records of a data file. Out: a PNG next to that file.
"""
