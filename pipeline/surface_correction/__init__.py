"""A surface corrected by registered frames of it: where they agree on another place than the surface has.

Points on the surface move along its normals, and the frames' poses with them, until what one frame shows lies where the
others show it. It is for research: a corrected surface must not guide a surgeon.
"""

SURFACE, MAP, PAGE, CASE = "surface_corrected.ply", "deviation.png", "deviation.html", "case.toml"
"""Names of the files of a correction."""
NOT_FOR_SURGERY = "for research only: it must not guide a surgeon"
