"""The block in three dimensions: geometry, mesh, named faces, symmetry; no form."""
