"""Accuracy and speed: how good the results are.

In: synthetic views and photographs, poses and the ground truth. Out: figures, tables and charts.
"""
