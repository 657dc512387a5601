"""Viscoelasticity with two relaxation times: a second branch beside that of ``maxwell``.

Each branch is off where its g is 0; with g₂ = 0 this is ``maxwell``.
"""

from cutbench.mechanisms.bulk.maxwell import Maxwell, branch_parameters


class Maxwell2(Maxwell):
    """Two Maxwell branches."""

    name = "maxwell2"
    title = "viscoelasticity (two)"
    family = "viscoelasticity"
    resembles = ("G",)
    parameters = (*Maxwell.parameters, *branch_parameters("2", 500.0, 0.3))
