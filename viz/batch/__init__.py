"""Many recordings at once, on dask: what each becomes, where it is kept, and who does the work."""
