"""In: a view and a photograph, or features of many of both. Out: how near they are, and how near they could be.

May use OpenCV.
"""
