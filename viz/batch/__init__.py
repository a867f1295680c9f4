"""Many recordings at once on dask: the work, its results, and the cluster."""
