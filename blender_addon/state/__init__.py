"""The state that a scene stores: properties, and their conversion to and from the pipeline's types."""
