"""A case at its pose, drawn over its frame or the frames of a video, as augmented reality shows it.

In: a case and poses, and what draws letters. Out: pictures with legend and scale bar.
"""
