"""Registration of a case's further frames: reads the case and the frames, writes poses and pictures."""
