"""Panels *Open*, *Save* and *History*: open a case, or load frame, camera and surface in any order."""
