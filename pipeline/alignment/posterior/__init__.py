"""One posterior of the frame's pose: landmarks, image and priors are evidence in one solve.

:mod:`.evidence` is what they are, :mod:`.solve` the pose from all of them, :mod:`.next_click` where the next landmark
gains most.
"""
