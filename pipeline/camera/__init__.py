"""The pinhole camera.

In: calibration files of other programs, or numbers. Out: :class:`~.pinhole.PinholeCamera`, and whether it fits the
frame.
"""
