"""Panel *Move*: change the pose by keys, handles and numbers."""
