"""A dataset run: many views, many processes.

In: a case and options. Out: a dataset, resumable at any time.
"""
