"""Weak forms, one a slot, free of dimension. A form turns laws into local vectors and matrices."""

from cutbench.forms.base import Form, Local, Step

__all__ = ["Form", "Local", "Step"]
