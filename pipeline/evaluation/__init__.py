"""How good the views are.

In: views and photographs of the same poses. Out: scores, with their confidence and what could be reached, as a record
and as tables.
"""
