"""The only code below the add-on that needs Blender: scenes from data, renders to arrays, the dataset job.

One Blender unit is one millimetre, the world is the ``model`` frame (see :mod:`pipeline.frames`).
"""
