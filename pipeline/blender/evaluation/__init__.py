"""Views compared with photographs of the same poses.

In: a case and posed photographs. Out: figures and pictures.
"""
