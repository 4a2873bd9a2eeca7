"""Many machines: the views of a run as futures of a Dask cluster, which runs them again if a worker dies.

A scheduler gives workers. On each, the run has a plugin that keeps what orders need, such as a render process.
"""
