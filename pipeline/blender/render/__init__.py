"""Rendering the surface at a pose.

In: a surface with colours, a camera, a pose. Out: :class:`~pipeline.dataset.view.RenderedView`.
"""
