"""Arrays of pixels, and their files.

In: arrays of code values. Out: PNG files, contact sheets, overlays; and the check that an image file is whole.
"""
