"""Panel *Set up*: open a case, or load frame, camera and surface in any order."""
