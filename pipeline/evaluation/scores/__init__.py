"""In: a view and a photograph. Out: how near they are, and how near they could be.

May use OpenCV.
"""
