"""From dropped files and a few fields to a campaign that ``cutbench fit`` and ``discover`` take, too."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from cutbench.base.errors import BadInput
from cutbench.base.files import write_text
from cutbench.case.case import Case
from cutbench.data.campaign import load_campaign
from cutbench.data.columns import lines_of
from cutbench.data.contact import TAKEN_OFF

#: A file of readings is no larger, bytes.
MAX_FILE_BYTES = 20_000_000
_NAME = re.compile(r"[\w][\w .+-]{0,80}\.(csv|txt|tsv|dat|toml)", re.IGNORECASE)
#: What a request may hold: the fields of an experiment, each a text or an object of texts.
_FIELDS = ("kind", "columns", "units", "specimen", "blade", "speed", *TAKEN_OFF)
#: Kinds of tests, as the page calls them.
KINDS = {
    "cut": "cutting",
    "uniaxial": "tension or compression",
    "pure_shear": "pure shear",
    "equibiaxial": "equibiaxial tension",
}
#: Columns by kind of test, with the unit that is taken where none is written, and what their names look like.
_FORCES = ("displacement", "force", "time")
ROLES = {
    "cut": _FORCES,
    "uniaxial": _FORCES,
    "pure_shear": _FORCES,
    "equibiaxial": ("stretch", "stress", "time"),
}
_LIKE = {
    "displacement": r"dis|trav|ext|way|weg|elong|position|^u\b",
    "force": r"force|load|kraft|^f\b",
    "time": r"time|zeit|^t\b",
    "stretch": r"stretch",
    "stress": r"stress",
}
#: Sizes of the specimen by kind of test; those of a cut are the material's, the others nobody can guess.
SIZES: dict[str, dict[str, dict[str, str]]] = {
    "cut": {"specimen": dict.fromkeys(("width", "length", "height"), "")},
    "uniaxial": {"specimen": {"length": "", "area": ""}},
    "pure_shear": {"specimen": {"length": "", "area": ""}},
    "equibiaxial": {},
}


def keep_file(folder: Path, name: str, content: bytes) -> list[str]:
    """Write an uploaded file into ``folder``; its first lines. Raises BadInput for a name or a content that
    is none of a table's or a campaign's."""
    if not _NAME.fullmatch(name):
        raise BadInput(
            "file", name, "a name such as curve.csv: letters, digits, blanks; .csv, .txt, .tsv, .dat or .toml"
        )
    if not content or len(content) > MAX_FILE_BYTES:
        raise BadInput(name, f"{len(content)} bytes", f"1 to {MAX_FILE_BYTES} bytes")
    wide = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    if b"\0" in content and not wide:
        raise BadInput(name, "binary", "a table as text")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(content)
    return [line[:200] for line in lines_of(folder / name)[:12]]


def sizes_of(kind: str, start: Case) -> dict[str, dict[str, str]]:
    """Sizes that a test of this kind has, by section; of a cut with the values of the case to begin with."""
    sizes = {section: dict(texts) for section, texts in SIZES[kind].items()}
    if kind == "cut" and (tool := start.model.tool) is not None:
        sizes["blade"] = {q.name: "" for q in tool.parameters if q.default != 0}  # not how it lies
        return {section: {name: start[name] for name in texts} for section, texts in sizes.items()}
    return sizes


def column_names(head: Sequence[str]) -> list[str]:
    """The titles in the first lines of a table; none where there are none."""
    for line in head:
        cells = [cell.strip().strip('"') for cell in re.split(r"[;\t|,]", line)]
        if len(cells) > 1 and sum(bool(re.search("[a-z]", cell, re.I)) for cell in cells) > 1:
            return cells
    return []


def likely_columns(head: Sequence[str], kind: str) -> dict[str, str]:
    """Which column of a table plays which role, by names in its first lines; empty where none seems to."""
    names = column_names(head)
    return {
        role: next((name for name in names if re.search(_LIKE[role], name, re.I)), "") for role in ROLES[kind]
    }


def write_campaign(folder: Path, request: Mapping[str, object], start: Case) -> Path:
    """The campaign file of ``request``, beside its data, of tests of the material and with the blade of
    ``start``; read and found good. Raises BadInput."""
    names = request.get("files") or []
    if not isinstance(names, list) or not names:
        raise BadInput("files", names, "one file at least")
    lines = [
        f"title = {_text('Readings from ' + ', '.join(map(str, names)))}",
        f"material = {_text(request.get('material', 'gelatin'))}",
    ]
    if request.get("kind") == "cut":
        lines.append(f"baseline = {json.dumps(start.mechanisms)}")
    for place, name in enumerate(names):
        if not _NAME.fullmatch(str(name)) or not (folder / str(name)).is_file():
            raise BadInput("files", name, "a file that was uploaded")
        lines += [
            "",
            "[[experiment]]",
            f"id = {_text(f'{place + 1} {Path(str(name)).stem}')}",
            f"data = {_text(name)}",
        ]
        for key in _FIELDS:
            if value := request.get(key):
                lines.append(f"{key} = {_value(value)}")
    target = write_text("\n".join(lines), folder / "campaign.toml")
    load_campaign(target)
    return target


def _text(value: object) -> str:
    """A TOML text: JSON's, of which TOML takes all escapes that ``json`` writes but that of DEL."""
    return json.dumps(str(value)).replace("\x7f", "")


def _value(value: object) -> str:
    if isinstance(value, Mapping):
        inner = ", ".join(
            f"{json.dumps(str(k))} = {_value(v)}" for k, v in value.items() if v not in ("", None)
        )
        return "{ " + inner + " }"
    return str(value) if isinstance(value, int) else _text(value)
