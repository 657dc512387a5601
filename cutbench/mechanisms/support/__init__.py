"""Mechanisms of one slot, one a file."""
