"""Check whether a dataset is complete and consistent.

In: the folder of a dataset. Out: findings. What converts and projects here is not what writes, so that an error in that
cannot hide itself.
"""
