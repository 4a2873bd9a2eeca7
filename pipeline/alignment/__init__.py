"""The pose of the frame.

In: a case, and what the user points at. Out: ``cam_from_model`` and its uncertainty. The pose is found by hand
(``manual``), from landmarks (``landmarks``) or from the image itself (``refinement``).
"""
