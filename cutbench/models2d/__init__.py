"""Plane-strain section: geometry, mesh, named faces, symmetry; no form."""
