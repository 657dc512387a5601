"""Parts of one test that stand below each other in a file, or in files of their own, and times that go on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.data.clock_times import between_ticks
from cutbench.data.rows import CYCLES, SPECIMENS
from cutbench.data.table import Table

CYCLE, SPECIMEN = "cycles", "specimens"
#: What blocks below each other may be.
BLOCKS = (CYCLE, SPECIMEN)
#: A part that begins within so many steps of where the one before began has a clock of its own.
_RESTART_STEPS = 2.0
#: Travel between files that follow one another, as a part of the way, which is spoken of.
_NOTED_GAP = 0.05


def with_blocks_read(table: Table, blocks: str | None = None) -> Table:
    """A file with blocks below each other as cycles of one specimen or as specimens: as ``blocks`` says, else
    what stands above them, else the time, which goes on over cycles and begins anew with each specimen.

    A note says what was taken. Raises BadInput where nothing decides.
    """
    table, count = _with_times_between_ticks(table), len(table.titles)
    if count == 1:
        return table
    how, why = (blocks, "as blocks says") if blocks else _kind(table)
    note = f"{table.path.name} holds {count} blocks below each other, read as {how}, {why}"
    distinct = all(table.titles) and len(set(table.titles)) == count
    if how == CYCLE:
        names = table.titles if distinct else tuple(f"block {k + 1}" for k in range(count))
        return _continued(replace(table, titles=names, notes=(*table.notes, note)))
    names = table.titles if distinct else tuple(str(k + 1) for k in range(count))
    own = [names[block] for block in table.blocks]
    if table.labels is not None:
        own = [f"{a}/{b}" for a, b in zip(table.labels, own, strict=True)]
    note += f": {', '.join(dict.fromkeys(own))}"
    return replace(table, labels=tuple(own), titles=("",), notes=(*table.notes, note))


def _with_times_between_ticks(table: Table) -> Table:
    """Each reading of a specimen and a block at its own time, where the clock was too coarse for that."""
    if "time" not in table.columns:
        return table
    recorded, times = table.columns["time"], table.columns["time"].copy()
    labels = np.array(table.labels if table.labels is not None else [""] * times.size)
    for label in dict.fromkeys(labels):
        for block in range(len(table.titles)):
            part = (labels == label) & (table.blocks == block)
            times[part] = between_ticks(times[part])
    if np.array_equal(recorded, times):
        return table
    note = f"{table.path.name}: more readings than its clock ticks; their times are even between the ticks"
    return replace(table, columns={**table.columns, "time": times}, notes=(*table.notes, note))


def joined_files(tables: Sequence[Table]) -> Table:
    """Files that follow one another as one. Raises BadInput if only one has labels, or a clock."""
    first = tables[0]
    for other in tables[1:]:
        if (other.labels is None, other.clock) != (first.labels is None, first.clock):
            expected = f"specimens and times as in {first.path.name}, which it follows"
            raise BadInput(key="data", value=other.path.name, expected=expected)
    if len(tables) == 1:
        return first
    whole = replace(
        first,
        columns={role: np.concatenate([t.columns[role] for t in tables]) for role in first.columns},
        labels=None if first.labels is None else sum((t.labels or () for t in tables), ()),
        lines=np.concatenate([t.lines for t in tables]),
        files=sum((t.files for t in tables), ()),
        blocks=np.repeat(np.arange(len(tables)), [t.lines.size for t in tables]),
        titles=tuple(t.path.name for t in tables),
        notes=sum((t.notes for t in tables), ()),
    )
    apart = []
    for a, b in pairwise(tables):
        if "displacement" in first.columns:
            x, begins = a.columns["displacement"], b.columns["displacement"][0]
            if abs(begins - x[-1]) > _NOTED_GAP * np.ptp(x):
                gap = f"{abs(begins - x[-1]):.4g} mm"
                apart.append(f"{b.path.name} begins {gap} from where {a.path.name} ends")
    return _continued(replace(whole, notes=(*whole.notes, *apart)))


def _kind(table: Table) -> tuple[str, str]:
    """What the blocks are, and why."""
    if table.labels is not None and not table.specimens:
        return CYCLE, "as a column names the specimens"
    for how, words in ((CYCLE, CYCLES), (SPECIMEN, SPECIMENS)):
        named = list(dict.fromkeys(title for title in table.titles if words.match(title)))
        if len(named) >= len(table.titles) - 1:
            return how, f"as '{named[-1]}' says"
    second = np.searchsorted(table.blocks, 1)
    if "time" in table.columns and not table.specimens:
        parts = [table.columns["time"][table.blocks == k] for k in range(len(table.titles))]
        if all(b[0] >= a[-1] for a, b in pairwise(parts)):
            return CYCLE, "as their time goes on"
        if all(b[0] < (a[0] + a[-1]) / 2 for a, b in pairwise(parts)):
            return SPECIMEN, "as their time begins anew"
    raise BadInput(
        file=str(table.path), line=int(table.lines[second]), key="blocks", value="a heading once more",
        expected="blocks = 'cycles' in the campaign, for parts of one specimen, or blocks = 'specimens'",
    )  # fmt: skip


def _continued(table: Table) -> Table:
    """The parts of each specimen as one, with times that go on, and notes on how they do.

    A part whose time begins where that of the one before began has a clock of its own, and follows at its own
    step; one that begins before the end of that is recorded twice up to there, and the later record counts.
    """
    labels = np.array(table.labels if table.labels is not None else [""] * table.lines.size)
    each = [np.flatnonzero(labels == label) for label in dict.fromkeys(labels)]
    columns, keep = dict(table.columns), np.ones(labels.size, dtype=bool)
    notes: dict[str, str] = {}
    if "time" in columns:
        recorded, columns["time"] = columns["time"], columns["time"].copy()
        for mine in each:
            parts = [mine[table.blocks[mine] == k] for k in range(len(table.titles))]
            shift = 0.0
            for before, part in pairwise([part for part in parts if part.size]):
                begins, began, ended = recorded[part[0]], recorded[before[0]], recorded[before[-1]]
                step = float(np.median(np.diff(recorded[part]))) if part.size > 1 else 1.0
                if begins > ended:
                    how = "goes on by the clock of"
                elif begins < began + _RESTART_STEPS * step:
                    shift += float(ended + step - begins)
                    how = f"has a clock of its own, and follows {step:.4g} s after"
                else:
                    again = before[recorded[before] >= begins]
                    keep[again] = False
                    how = f"begins before the end; left out are {again.size} of the last readings of"
                columns["time"][part] += shift
                names = [table.titles[table.blocks[rows[0]]] for rows in (part, before)]
                notes.setdefault(how, f"{names[0]} {how} {names[1]}")
    rows = np.concatenate(each)
    rows = rows[keep[rows]]
    return replace(
        table,
        columns={role: values[rows] for role, values in columns.items()},
        labels=None if table.labels is None else tuple(labels[rows].tolist()),
        lines=table.lines[rows],
        files=tuple(table.files[k] for k in rows),
        blocks=table.blocks[rows],
        titles=("",),
        notes=(*table.notes, *notes.values()),
    )
