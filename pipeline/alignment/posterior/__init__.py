"""One posterior of the frame's pose: landmarks and image are evidence in one solve.

:mod:`.solve` is the pose from both, :mod:`.next_click` where the next landmark gains most.
"""
