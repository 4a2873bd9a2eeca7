"""Charts of what was measured, drawn by matplotlib, which is optional: ``pip install 'oneframe[charts]'``.

In: records that a data file holds. Out: SVG and PNG beside that file, each for light and for dark pages.
"""
