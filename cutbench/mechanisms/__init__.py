"""Mechanisms: one effect, one file. A law alone declares its parameters, groups, levers and names."""

from cutbench.base.symbols import iterated
from cutbench.base.units import Parameter
from cutbench.mechanisms.base import (
    Answer,
    Blade,
    Bulk,
    Cut,
    Estimate,
    Group,
    Mechanism,
    Points,
    Rig,
    Skin,
    Support,
    Tool,
)
from cutbench.mechanisms.blade._profile import Profiled, flank
from cutbench.mechanisms.blade.contact import Contact
from cutbench.mechanisms.bulk._isotropic import Isochoric, Isotropic, TwoInvariants, Volumetric
from cutbench.mechanisms.bulk.neo_hookean import NeoHookean
from cutbench.mechanisms.cut.smith_ferrante import SmithFerrante
from cutbench.mechanisms.law_registry import SLOTS, file_of, known_mechanisms, registry
from cutbench.mechanisms.own_laws import use_mechanisms

__all__ = [
    "SLOTS",
    "Answer",
    "Blade",
    "Bulk",
    "Contact",
    "Cut",
    "Estimate",
    "Group",
    "Isochoric",
    "Isotropic",
    "Mechanism",
    "NeoHookean",
    "Parameter",
    "Points",
    "Profiled",
    "Rig",
    "Skin",
    "SmithFerrante",
    "Support",
    "Tool",
    "TwoInvariants",
    "Volumetric",
    "file_of",
    "flank",
    "iterated",
    "known_mechanisms",
    "registry",
    "use_mechanisms",
]
