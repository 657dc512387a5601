"""Mechanisms: one effect, one file. A law alone declares its parameters, groups, levers and names."""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import (
    Answer,
    Blade,
    Bulk,
    Cut,
    Mechanism,
    Points,
    Rig,
    Skin,
    Support,
)
from cutbench.mechanisms.bulk._isotropic import Isochoric, Isotropic
from cutbench.mechanisms.bulk.neo_hookean import NeoHookean
from cutbench.mechanisms.cut.smith_ferrante import SmithFerrante
from cutbench.mechanisms.registered import SLOTS, file_of, registry, use_mechanisms

__all__ = [
    "SLOTS",
    "Answer",
    "Blade",
    "Bulk",
    "Cut",
    "Isochoric",
    "Isotropic",
    "Mechanism",
    "NeoHookean",
    "Parameter",
    "Points",
    "Rig",
    "Skin",
    "SmithFerrante",
    "Support",
    "file_of",
    "registry",
    "use_mechanisms",
]
