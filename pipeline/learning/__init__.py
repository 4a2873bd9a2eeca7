"""A network that learns from views which point of the surface a frame shows where.

In: a dataset. Out: an ONNX file, and from it a first pose of a frame, for registration to refine and to judge. Training
needs PyTorch; the rest needs ``cv2``.
"""
