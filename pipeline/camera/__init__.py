"""The pinhole camera.

In: calibration files of other programs, or numbers. Out: :class:`~.pinhole.PinholeCamera`, its distortion, and warnings
where it does not fit the frame.
"""
