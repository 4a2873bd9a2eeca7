"""Panel *Move*: the pose by keys, handles and numbers."""
