"""A blunt tip: the ellipse's length is b/(1 + w) instead of b, its apex where the sharp one's would be.

The radius of the tip grows from a²/b to (1 + w) a²/b. w = 0 is the law ``contact``.
"""

from cutbench.base.units import Parameter
from cutbench.mechanisms.blade.contact import Contact


class BluntTip(Contact):
    """Contact with a blade that is blunter than its drawing."""

    name = "blunt_tip"
    title = "contact (blunt tip)"
    family = "tool"
    resembles = ("tip",)
    parameters = (
        *Contact.parameters,
        Parameter.effect(
            "blunting", "1", "w", "growth of the tip's radius, relative", high=20.0, typical=0.5
        ),
    )

    def groups(self, p):
        a, b = self.half_axes(p)
        return {"b/a": b / a, "blunting": p.blunting}

    def like(self, p):
        return {"tip": p.tip / (1 + p.blunting)}

    def half_axes(self, p):
        return p.thickness / 2, self.like(p)["tip"]
