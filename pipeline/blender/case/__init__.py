"""A case, read with Blender's image readers.

In: the path of a case file. Out: :class:`~oneframe.case.loaded_case.LoadedCase`.
"""
