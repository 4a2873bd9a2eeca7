"""A surface corrected by registered frames of it: where they agree on another place than the surface has.

Points on the surface move along its normals, and the frames' poses with them, until what one frame shows lies where the
others show it. It is for research: a corrected surface must not guide a surgeon.
"""
