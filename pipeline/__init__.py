"""From one aligned frame and a CT-derived surface to posed views with exact ground truth.

Modules are the nouns of the field, in the order in which data flows::

    mesh -> camera -> case -> visibility -> colouring -> sampling -> blender.render -> dataset

Everything in this package is pure (numpy and the standard library; ``cv2`` and ``skimage`` only in the modules
that name them in their docstring). Code that needs Blender lives in :mod:`pipeline.blender`.
"""

__version__ = "0.1.0"
