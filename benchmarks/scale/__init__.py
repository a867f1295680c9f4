"""Many recordings on dask."""
