"""In *Set up*: a video with its scores as a strip below the view, to choose the frame from."""
