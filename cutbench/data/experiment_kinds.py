"""Kinds of tests: what an experiment of each is described by, and what people call tests that are of none."""

from __future__ import annotations

import re
from collections.abc import Mapping

from cutbench.base.errors import BadInput
from cutbench.base.toml import in_short, nearest, one_of
from cutbench.data.experiment import HOMOGENEOUS, KINDS

#: Columns that give the abscissa and the ordinate, by kind: exactly one of each.
ABSCISSA = {
    **dict.fromkeys(HOMOGENEOUS, ("displacement", "stretch", "strain")),
    **dict.fromkeys(("cut", "sliding", "separation"), ("displacement",)),
}
ORDINATE = {"cut": ("force",), **dict.fromkeys((*HOMOGENEOUS, "sliding", "separation"), ("force", "stress"))}
SIZES = {
    "cut": ("width", "length", "height", "precut"),
    **dict.fromkeys(HOMOGENEOUS, ("length", "area", "diameter", "width", "thickness")),
    "sliding": ("area", "diameter", "length", "width"),
    "separation": ("area", "diameter", "length", "width"),
}
_EVERY = (
    "id", "kind", "data", "columns", "units", "factors", "specimen", "speed", "role", "from", "until",
    "source", "blocks", "skip",
)  # fmt: skip
_EXTRA = {
    "cut": ("blade", "fields", "zero", "force_zero", "measures", "depth"),
    **dict.fromkeys(HOMOGENEOUS, ("stress", "strain", "zero", "force_zero")),
    "sliding": ("pressure", "normal_force"),
    "separation": ("direction", "zero", "force_zero"),
}

_TIMED = (
    "how the specimen is loaded, such as 'uniaxial', with a column of time: holds and cycles follow from it"
)
_NONE = f"one of {', '.join(KINDS)}: none of these is "
#: What to write for what people call tests, by words in the name; the first that is in it counts.
_MEANT = {
    ("cutting", "slicing"): "'cut'",
    ("planar", "pure"): "'pure_shear', a wide strip that is pulled",
    ("biaxial", "inflation", "bulge"): "'equibiaxial', if both directions are stretched alike",
    ("compress", "press", "tpa"): (
        "'uniaxial', with factors = { displacement = -1, force = -1 } if the machine counts down as positive"
    ),
    ("tension", "tensile", "pull_test", "traction", "elongation", "uni_axial"): "'uniaxial'",
    ("relax", "creep", "hold", "cycl", "hysteresis", "fatigue", "load"): _TIMED,
    ("indent", "punct", "needle", "hardness", "penetr"): (
        _NONE + "a body pressed in; between plates it is 'uniaxial', and a modulus is G in [parameters]"
    ),
    ("peel", "tear", "trouser", "fracture", "notch"): (
        _NONE
        + "this; its energy of fracture or adhesion is a value in [parameters], such as G_c = '10 J/m^2'"
    ),
    ("tack", "probe", "pull_off", "adhes", "cohesi", "debond"): (
        "'separation', where the traction over the opening was measured, with direction = 'opening'"
    ),
    ("friction", "tribo", "rub"): "'sliding'",
    ("shear", "torsion", "rheo", "oscill", "dma", "bend", "flex", "impact"): (
        _NONE + "this; a modulus that it gives is G in [parameters], and 'pure_shear' is a wide strip, pulled"
    ),
}
#: A kind is a misspelt one above this likeness; below it, it is another test.
_LIKE = 0.85


def kind_of(table: Mapping[str, object]) -> str:
    """The kind of the experiment that ``table`` describes. Raises BadInput, also for keys of other kinds."""
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise BadInput(key="kind", value=in_short(kind), expected=_instead(kind))
    for key in table:
        if key not in (*_EVERY, *_EXTRA[kind]):
            owners = [k for k, keys in _EXTRA.items() if key in keys]
            expected = one_of(key, (*_EVERY, *_EXTRA[kind]))
            if owners:
                expected = f"it in a test of kind {' or '.join(owners)}, not {kind}"
            raise BadInput(key=key, value=in_short(table[key]), expected=expected)
    return kind


def _instead(kind: object) -> str:
    """What to write for a kind that is none."""
    word = re.sub(r"[^a-z]+", "_", str(kind).lower())
    if nearest(word, KINDS, _LIKE) is None:
        for names, meant in _MEANT.items():
            if any(name in word for name in names):
                return meant
    guess = nearest(word, KINDS, _LIKE)
    return f"one of {', '.join(KINDS)}" + (f"; did you mean '{guess}'?" if guess else "")
