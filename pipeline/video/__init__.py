"""From a microscope video to a frame.

In: a video file. Out: single frames of it.
"""

SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".mpg", ".mpeg", ".webm", ".ts", ".mts", ".wmv", ".mxf")
"""By which a file is offered, or called a video; whether it is one its content tells."""
