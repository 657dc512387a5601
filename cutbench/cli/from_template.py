"""Commented files to start from: a template with a name and a place put in."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

from cutbench.base.errors import BadInput
from cutbench.base.files import write_text
from cutbench.base.report import filled


def write_template(
    kind: str, target: Path, *, name: str = "", beside: Mapping[Path, Callable[[], str]] | None = None
) -> list[str]:
    """Write the template of this ``kind`` to ``target`` with a material's ``name``, and what is to lie
    ``beside`` it; returns the lines to say: what was written, and what to do with it. Raises BadInput for a
    file that is there, or a place where none can be."""
    beside = beside or {}
    if target.suffix != ".toml" or not target.parent.is_dir():
        raise BadInput("FILE.toml", str(target), "a file ending in .toml, in a folder that is there")
    for path in (target, *beside):
        if path.exists():
            raise BadInput("FILE.toml", str(path), "a file that is not there yet: nothing is written over")
    parts = {
        "FILE": str(target), "LEAF": target.name, "STEM": target.stem,
        "NAME": json.dumps(name, ensure_ascii=False),
    }  # fmt: skip
    text = filled("cutbench.cli", f"templates/{kind}.toml", parts)
    write_text(text, target)
    for path, make in beside.items():
        write_text(make(), path)
    return [*map(str, (target, *beside)), text.splitlines()[0].removeprefix("# ")]
