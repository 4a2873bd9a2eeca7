"""Aligning a frame: from landmarks, pins and nudges to a pose with its uncertainty.

Pure, like the package around it. ``landmarks`` and ``nudge`` need numpy only; what needs ``cv2`` names it in its
docstring. ``skimage`` is not to be used here: the add-on carries these modules.
"""
