"""Views compared with photographs of the same poses, and the speed of rendering.

In: a case and posed photographs; nothing for the speed. Out: figures and pictures.
"""
