"""What does not fit on one machine: finished datasets of any size, and a model of many workers.

In: a number of views and workers. Out: times, memory and efficiency.
"""
