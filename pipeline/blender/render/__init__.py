"""Rendering the surface at a pose.

In: a surface with colours, a camera, a pose. Out: :class:`~oneframe.projection.rendered_view.RenderedView`.
"""
