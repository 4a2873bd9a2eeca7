"""What the scene knows: properties, and their way to and from the data of the pipeline."""
