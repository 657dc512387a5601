"""As ``surface_gradient``, but the top goes on across the cut plane until that is cut

A surface that stays whole under a blunt tip bridges the plane, which then opens below it. When the bridge
is cut depends on the stiffness of the contact and on the elements: this is a bound, not a default.
"""

from cutbench.mechanisms.skin.surface_gradient import SurfaceGradient


class WholeSurfaceGradient(SurfaceGradient):
    """Resistance to gradients of the deformation, of a top that no edge has nicked."""

    name = "whole_surface_gradient"
    title = "surface gradient (whole)"
    family = "surface"
    continuous = True
    alternatives = ("surface_gradient",)
