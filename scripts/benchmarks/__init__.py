"""The topics of ``scripts/benchmark.py``, a module each: what measures the product beside other programs.

They import the product, never the reverse, and no package that is installed holds them.
"""
