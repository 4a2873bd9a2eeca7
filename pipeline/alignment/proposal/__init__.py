"""Poses proposed from the frame alone, without a rough pose."""
