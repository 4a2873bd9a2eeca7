"""Sweeps past the point where a method fails: what the software answers there."""
