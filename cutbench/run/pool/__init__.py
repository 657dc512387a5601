"""The processes that compute many runs: local ones, or the workers of a Dask scheduler."""
