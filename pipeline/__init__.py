"""From one aligned frame and a CT-derived surface to posed views with exact ground truth.

A folder is a stage, in the order in which data flows; its files are the nouns of the field:

========================  =====================================================================
``volume``                CT -> bone surface
``surface``               the triangle mesh
``video``                 microscope video -> frame
``camera``                K and distortion
``projection``            a mesh as a camera sees it: rasteriser, z-buffer, silhouette
``case``                  one frame, K, surface, pose, structures, landmarks
``alignment``             the pose of the frame: by hand, from landmarks, from the image itself
``colour``                what the frame saw, on the surface
``poses``                 new camera poses
``dataset``               views on disk, their tables, and the check of both
``packing``               a dataset as WebDataset shards
``reader``                a dataset or a pack, view by view as arrays
``evaluation``            how good it is
``charts``                figures as pictures
``sample``                the built-in case
``blender``               the same topics, where they need Blender
``commands``              what users call: the program ``oneframe`` and the scripts
========================  =====================================================================

Below them lie ``files`` and ``images``, :mod:`oneframe.transforms` (the conventions, as code), ``progress`` and
``errors``. Everything is pure (numpy and the standard library; ``cv2``, ``skimage`` and ``scipy`` only in ``video``,
``volume``, ``sample``, ``alignment``, ``evaluation``, ``reader``, ``packing.jpeg`` and ``dataset.check``) except
:mod:`oneframe.blender` and the commands that call it.
"""

__version__ = "0.1.0"
