"""A model and its values without numerics: what can be said of a case that another version has computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace

from cutbench.base.errors import BadInput, require
from cutbench.case.model import Model
from cutbench.case.numerics import KEYS
from cutbench.case.outline import Points, read_outline
from cutbench.case.values import as_written, names, resolve


@dataclass(frozen=True)
class Physics:
    """Laws and all their values in internal units. Raises BadInput if one is missing."""

    model: Model
    values: Mapping[str, float]
    outline: Points = ()

    def __post_init__(self) -> None:
        for name in self.model.parameters():
            require(name in self.values, name, "(missing)", "a value, which these laws need today")

    @classmethod
    def from_dict(cls, data: Mapping) -> Physics:
        """That of a case as ``Case.to_dict`` describes it, whatever its numerics are. Raises BadInput."""
        try:
            model = Model(tuple(data["mechanisms"]))
            written = as_written(data["values"])
        except (KeyError, TypeError, AttributeError) as error:
            raise BadInput("case", str(error), "a case as Case.to_dict() writes it") from error
        outline = read_outline(data["outline"]) if "outline" in data else ()
        return cls(model, resolve({}, written, model), outline)

    @property
    def mechanisms(self) -> tuple[str, ...]:
        return self.model.mechanisms

    @property
    def p(self) -> SimpleNamespace:
        """The values by attribute, as laws read them."""
        return self.model.namespace(self.values, self.outline)

    def groups(self) -> dict[str, float]:
        """The dimensionless groups of all its mechanisms."""
        return self.model.groups(self.p)

    def set(self, mechanisms: object = None, **changes: object) -> Physics:
        """With other laws and values as ``Case.set`` takes them; what belongs to a run is passed over."""
        model = self.model if mechanisms is None else Model(names(mechanisms, key="mechanisms"))
        own = {key: value for key, value in changes.items() if key not in (*KEYS, "motion", "until")}
        return Physics(model, resolve(self.values, own, model), self.outline)
