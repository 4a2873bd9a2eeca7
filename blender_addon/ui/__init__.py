"""What all topics draw and click with."""
