"""Viscoelasticity with three relaxation times: a third branch beside those of ``maxwell2``.

Each branch is off where its g is 0; with g₃ = 0 this is ``maxwell2``.
"""

from cutbench.mechanisms.bulk.maxwell import branch_parameters
from cutbench.mechanisms.bulk.maxwell2 import Maxwell2


class Maxwell3(Maxwell2):
    """Three Maxwell branches."""

    name = "maxwell3"
    title = "viscoelasticity (three)"
    parameters = (*Maxwell2.parameters, *branch_parameters("3", 5000.0, 0.2))
