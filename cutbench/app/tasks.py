"""What the workbench computes, each in a process of its own: a run, a fit, a discovery."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from cutbench.base.figure_style import save
from cutbench.base.progress import OnProgress
from cutbench.calibration.fitting import fit
from cutbench.calibration.report import summary as fit_summary
from cutbench.calibration.report import write_fit
from cutbench.case.case import Case
from cutbench.data.campaign import load_campaign
from cutbench.discovery.page import write_discovery
from cutbench.discovery.report import summary as discovery_summary
from cutbench.discovery.search import discover
from cutbench.run.blade_geometry import blade_outline
from cutbench.run.figures.curve import plot_curve
from cutbench.run.figures.section import scale_end, split
from cutbench.run.files import write_run
from cutbench.run.outcome import run_sentence
from cutbench.run.result import Snapshot
from cutbench.run.runner import run_case

#: The section is shown so many times on the way down.
_SECTIONS = 60

Tell = Callable[[Mapping[str, object]], None]


def run(case: Case, folder: Path, tell: Tell) -> None:
    """Compute ``case`` and write it to ``folder``; tells points of the curve and sections as they come."""
    meshes: list[np.ndarray] = []

    def on_step(row: Mapping[str, float], snapshot: Snapshot | None) -> None:
        point = {"mm": _short(row["displacement_mm"]), "N": _short(row["force_N"])}
        tell({"point": point} | ({"section": _section(case, snapshot, meshes)} if snapshot else {}))

    wanted = [case.p.depth * (k + 1) / _SECTIONS for k in range(_SECTIONS)]
    result = run_case(case, on_progress=_progress(tell), on_step=on_step, snapshots_mm=wanted)
    result.snapshots = result.snapshots[-1:]
    write_run(result, folder)
    save(plot_curve(result), folder / "curve.png")
    numbers = {name: _short(value) for name, value in result.measures.items() if np.isfinite(value)}
    tell({
        "said": run_sentence(case, result.outcome, result.measures),
        "outcome": str(result.outcome),
        "measures": numbers,
        "files": sorted(path.name for path in folder.iterdir() if path.is_file()),
    })  # fmt: skip


def run_fit(campaign: Path, folder: Path, tell: Tell) -> None:
    """Fit the campaign's free parameters; tells the summary and the files."""
    found = fit(load_campaign(campaign), workers=1, on_progress=_progress(tell))
    write_fit(found, folder)
    _done(tell, fit_summary(found), folder)


def run_discovery(campaign: Path, folder: Path, tell: Tell) -> None:
    """Look for what the model lacks; tells the summary, the page and the files."""
    found = discover(load_campaign(campaign), workers=1, on_progress=_progress(tell))
    write_discovery(found, folder)
    _done(tell, discovery_summary(found), folder)


def _done(tell: Tell, text: str, folder: Path) -> None:
    files = sorted(path.name for path in folder.iterdir() if path.is_file())
    tell({"said": text, "files": files})


def _progress(tell: Tell) -> OnProgress:
    def on_progress(done: float, total: float, text: str) -> None:
        if total > 0 and np.isfinite(done / total):
            tell({"part": min(1.0, float(f"{done / total:.4g}")), "text": text})
        else:
            tell({"text": text})

    return on_progress


def _section(case: Case, snapshot: Snapshot, meshes: list[np.ndarray]) -> dict:
    """Corners' positions and stresses; the triangles only where the mesh is not that of the last one."""
    cells, top = split(snapshot.cells), 1.2 * case.p.height
    where, stress_kPa = snapshot.current[:, :2], 1e3 * snapshot.point_data["von_mises"]
    drawn = {
        "mm": _short(snapshot.displacement_mm),
        "x": np.round(where[:, 0], 3).tolist(),
        "y": np.round(where[:, 1], 3).tolist(),
        "kPa": np.round(stress_kPa, 2).tolist(),
        "top_kPa": _short(scale_end(where, cells, stress_kPa)),
        "blade": np.round(blade_outline(case, snapshot.displacement_mm, top), 3).tolist(),
        "full": bool(snapshot.points[:, 0].min() < -1e-9),
        "height": case.p.height,
        "width": case.p.width,
        "near": 4 * float(case.p.thickness),
    }
    if not (meshes and np.array_equal(meshes[-1], cells)):
        meshes[:] = [cells]
        drawn["cells"] = cells.ravel().tolist()
    return drawn


def _short(value: float) -> float:
    return float(f"{value:.5g}")
