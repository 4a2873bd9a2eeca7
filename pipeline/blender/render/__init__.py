"""Rendering the surface at a pose.

In: a surface with colours, a camera, a pose. Out: :class:`~oneframe.dataset.view.RenderedView`.
"""
