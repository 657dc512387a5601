"""One run: build a case's problem, march it, keep its energy ledger, curve, fields and measures.

Runs of many cases go through ``pool`` and are kept in ``store``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "checkpoint": ["Checkpoint"],
        "files": ["read_curve", "read_run", "write_run"],
        "result": ["Outcome", "Result", "Snapshot"],
        "runner": ["run_case"],
        "snap_back": ["trace_snap_back"],
        "store.runs": ["Store"],
        "tension": ["Tension", "run_tension", "strip_case"],
    },
)
