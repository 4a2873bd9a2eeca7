"""The frame and the surface in a scene, as the add-on and scripts align them.

In: a case. Out: a scene whose camera is the microscope, and what it sees of the surface.
"""
