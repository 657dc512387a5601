"""What the page lets a person choose, and the case that this makes."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cutbench.app.campaigns import keep_file
from cutbench.base.errors import BadInput
from cutbench.base.files import check_writable, write_text
from cutbench.base.units import Parameter
from cutbench.case.case import Case, load_case
from cutbench.case.case_file_text import case_text
from cutbench.case.materials import names
from cutbench.case.model import section_of, tools
from cutbench.case.motion import TRANSITION
from cutbench.case.numerics import PRESETS

#: A slider reaches so many times below and above the material's value.
_SPAN = 20.0
#: The page begins with a material that the atlas holds, and with what is computed soonest.
FIRST_MATERIAL, FIRST_NUMERICS = "gelatin", PRESETS[1]
#: Sizes that decide a cut; of the material those do that a group sets or a designer can change.
_SIZES = ("thickness", "tip", "angle", "height", "speed", "depth")


@dataclass(frozen=True)
class Slider:
    """A parameter ``q`` as the page shows it: its value and the ends of its slider, in its own unit, the
    section of a case file it stands in, and whether it is shown at first."""

    q: Parameter
    value: float
    low: float
    high: float
    section: str
    first: bool

    def place(self, value: float) -> float:
        """Where a value stands on the slider, from 0 to 1."""
        if self.low > 0:
            part = math.log(max(value, self.low) / self.low) / math.log(self.high / self.low)
        else:
            part = (value - self.low) / (self.high - self.low)
        return min(max(part, 0.0), 1.0)

    def at(self, place: float) -> float:
        """The value at a place of the slider."""
        if self.low > 0:
            return self.low * (self.high / self.low) ** place
        return self.low + place * (self.high - self.low)


@dataclass
class Choice:
    """What is chosen: a material and a blade, each by its name or the path of its file (without a ``blade``
    that of the material's file), and what is written for parameters (``texts``: numbers in the parameter's
    own unit, or with one)."""

    material: str = FIRST_MATERIAL
    blade: str = ""
    texts: dict[str, str] = field(default_factory=dict)
    numerics: str = FIRST_NUMERICS
    until: str = TRANSITION

    def start(self) -> Case:
        """The case of the material and the blade as they are. Raises BadInput."""
        case, blade = load_case(self.material), self.blade
        if not blade:
            return case
        if blade.endswith(".toml"):
            own = load_case(blade)
            tool = own.model.tool
            assert tool is not None, "a section has a blade"
            shown = {q.name: own.shown()[q.name] for q in tool.parameters}
            outline = {"outline": own.outline} if own.outline else {}
            return _with(case, tool.name).set(**outline, **shown)
        if blade not in (known := [law.name for law in tools()]):
            raise BadInput("tool", blade, f"one of {', '.join(known)}")
        return _with(case, blade)

    def case(self) -> Case:
        """The case with all that is written. Raises BadInput naming the parameter."""
        case = self.start()
        units = {name: q.unit for name, q in case.model.parameters().items()}
        values = {name: with_unit(text, units.get(name, "1")) for name, text in self.texts.items()}
        return case.set(**values, numerics=self.numerics, until=self.until)


def blades(folder: Path) -> dict[str, str]:
    """The material's own, the blades that need no file, and those in ``folder``: source and title."""
    laws = sorted((law for law in tools() if not law.measured), key=lambda law: (not law.standard, law.name))
    # In brackets a title says what tells a blade from the one with an elliptic tip.
    said = {law.name: re.search(r"\((.*)\)", law.title) for law in laws}
    named = {name: found[1] if found else "elliptic tip" for name, found in said.items()}
    return {"": "the material's own"} | named | _files(folder)


def materials(folder: Path) -> dict[str, str]:
    """The known materials and those in ``folder``: source and title."""
    return {name: name.replace("_", ", ") for name in names()} | _files(folder)


def sliders(case: Case) -> list[Slider]:
    """One for each parameter of a case that can have more than one value."""
    set_by_groups = {group.parameter for group in case.model.settable_groups().values()}
    found = []
    for q in case.model.parameters().values():
        value = case.values[q.name] / q.factor
        low, high = (value / _SPAN, value * _SPAN) if value > 0 else (min(0.0, value), 5 * abs(q.typical))
        low = max(low, -math.inf if q.low is None else q.low)
        high = min(high, math.inf if q.high is None else q.high)
        section = section_of(q.name)
        chosen = section == "parameters" and (bool(q.lever) or q.name in set_by_groups)
        if low < high:
            found.append(Slider(q, value, low, high, section, chosen or q.name in _SIZES))
    return found


def plain_name(q: Parameter) -> str:
    """A parameter in the words of who uses it: ``toughness (work of separation)``."""
    words = re.split(r"[;(:]", q.doc)[0].strip()
    return words if not q.lever or q.lever in words else f"{q.lever} ({words})"


def keep_case_files(folder: Path, given: Sequence[tuple[str, bytes]]) -> list[Path]:
    """Write uploaded case files, and the profiles that they name, into ``folder``; those that are cases.
    Raises BadInput for a file that cannot be used, and keeps no case that cannot be read."""
    for name, content in given:
        keep_file(folder, name, content)
    kept = [folder / name for name, _ in given if name.endswith(".toml")]
    for path in kept:
        try:
            load_case(path)
        except BadInput:
            path.unlink()
            raise
    return kept


def save_case(case: Case, name: str, folder: Path) -> Path:
    """Write a case under a name of its own, as a file that every command takes. Raises BadInput."""
    stem = re.sub(r"[^\w+-]+", "-", name).strip("-")
    if not stem or name in names():
        raise BadInput("name", name, "a name of its own, such as my gel")
    return write_text(case_text(case.set(name=name)), check_writable(folder) / f"{stem}.toml")


def with_unit(text: str, unit: str) -> object:
    """A number in the ``unit`` that it is meant in; any other text as it is."""
    try:
        number = float(text)
    except ValueError:
        return text
    return number if unit == "1" else f"{text.strip()} {unit}"


def _files(folder: Path) -> dict[str, str]:
    return {str(path): path.stem for path in sorted(folder.glob("*.toml"))}


def _with(case: Case, tool: str) -> Case:
    return case if tool in case.mechanisms else case.set(with_=tool)
