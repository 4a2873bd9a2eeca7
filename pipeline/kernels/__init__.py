"""Loops over triangles, pixels and points, compiled.

In: arrays. Out: arrays, in double precision, by one thread each, so that a result depends on nothing but its input.
"""
