"""Many machines: the orders of a run go to the workers of a Dask cluster; results come back, pixels never do.

A source gives workers, the feeder hands out orders and collects outcomes, and a task does an order on a worker.
"""
