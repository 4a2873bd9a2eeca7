"""The pose of the frame.

In: a case, and what the user points at. Out: ``cam_from_model``, and how sure it is: by hand (``manual``), from
landmarks (``landmarks``), from the image itself (``refinement``).
"""
