"""How good the views are.

In: views and photographs of the same poses. Out: scores, with their confidence, as tables and a figure.
"""
