"""Below *Open*: a video with its scores, to choose the frame from in Blender's Timeline."""
