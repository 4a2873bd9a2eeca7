"""Charts of what was measured, drawn by matplotlib, which is optional: ``pip install matplotlib``.

In: the records of a data file. Out: SVG and PNG next to that file, each for light and for dark pages.
"""
