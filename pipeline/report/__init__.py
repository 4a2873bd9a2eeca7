"""Pages to look at a dataset or an evaluation.

In: the folder of one. Out: one HTML file that needs no network and no other file. ``assets`` holds its style and
its scripts.
"""
