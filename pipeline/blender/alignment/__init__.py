"""The frame and the surface in a scene, for the alignment in the add-on and in scripts.

In: a case. Out: a scene whose camera is the microscope, and the part of the surface that it sees.
"""
