"""Finished runs on disk, under the hash of their inputs, and the list of them."""
