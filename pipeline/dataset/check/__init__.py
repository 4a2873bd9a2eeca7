"""Check whether a dataset is complete and consistent.

In: the folder of a dataset. Out: findings. Nothing here is shared with the code that writes, so that an error in that
cannot hide itself.
"""
