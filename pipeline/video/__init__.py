"""From a microscope video to a frame.

In: a video file. Out: single frames of it.
"""
