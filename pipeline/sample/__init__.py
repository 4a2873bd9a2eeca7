"""The built-in case.

In: a random generator. Out: a drilled temporal bone with its structures, and the poses of its photographs.
"""
