"""Stability: how the software answers when its input gets worse, past the point where it fails.

In: a seed. Out: cells of sweeps, each with the failures and the answers of its trials.
"""
