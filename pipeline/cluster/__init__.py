"""Many machines: the shards of a run as tasks of a Dask cluster, which does them again if a worker dies."""
