"""As ``surface_gradient``, but the top ends at the cut plane: its edge is free there before anything is cut

A surface is whole where the body is, so this is a bound, for comparison.
"""

from cutbench.mechanisms.skin.surface_gradient import SurfaceGradient


class FreeSurfaceGradient(SurfaceGradient):
    """Resistance to gradients of the deformation, of a top that is cut from the start."""

    name = "free_surface_gradient"
    title = "surface gradient (free)"
    continuous = False
