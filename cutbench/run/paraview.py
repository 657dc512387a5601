"""Fields for ParaView: series of VTU files over the blade's travel, of the body, its faces and the blade."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import meshio
import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.files import replacing
from cutbench.case.case import Case
from cutbench.run.blade_geometry import blade_mesh
from cutbench.run.result import Snapshot

#: Unit of each nodal field, appended to its name in the files.
_UNITS = {"displacement": "mm", "piola": "MPa", "cauchy": "MPa", "von_mises": "MPa"}


def write_fields(
    snapshots: Sequence[Snapshot], out_dir: str | Path, case: Case | None = None
) -> dict[str, Path]:
    """``fields.pvd`` (the body), ``faces.pvd`` (quadrature points of its faces) and, of a ``case`` with a
    blade, ``blade.pvd`` (its surface). Returns the paths by name.

    Each is a series of VTU files in ``fields/`` over blade travel in mm, ParaView's "time", or over the time
    in s where the travel does not rise from one snapshot to the next. Points lie where they were before
    loading; warping by ``displacement_mm`` moves all series alike. The faces' points carry opening, damage,
    contact pressure, tangential traction and contact state; ``face`` numbers the face they lie on (in the
    order of ``Snapshot.faces``, from 0). Without snapshots nothing is written. Files of an earlier run are
    removed.
    """
    out = Path(out_dir)
    folder = out / "fields"
    series: dict[str, list[tuple[float, str]]] = {"fields": [], "faces": [], "blade": []}
    for i, (at, snapshot) in enumerate(zip(_times(snapshots), snapshots, strict=True)):
        folder.mkdir(exist_ok=True)
        meshes = {"fields": _body(snapshot), "faces": _faces(snapshot)}
        if case is not None and case.model.tool is not None:
            # Long enough to stand out of the block at the last.
            top_mm = 1.2 * case.p.height + max(s.displacement_mm for s in snapshots)
            meshes["blade"] = blade_mesh(case, float(snapshot.displacement_mm), top_mm)
        for kind, mesh in meshes.items():
            if mesh is not None:
                name = f"{kind}_{i:04d}.vtu"
                with replacing(folder / name) as draft:
                    mesh.write(draft, file_format="vtu")
                series[kind].append((at, name))
    paths = {}
    for kind, entries in series.items():
        target = out / f"{kind}.pvd"
        if entries:
            rows = [f'    <DataSet timestep="{t!r}" part="0" file="fields/{name}"/>\n' for t, name in entries]
            with replacing(target) as draft:
                draft.write_text(
                    '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
                    + "".join(rows)
                    + "  </Collection>\n</VTKFile>\n"
                )
            paths[kind] = target
        else:
            target.unlink(missing_ok=True)
        for old in set(folder.glob(f"{kind}_*.vtu")) - {folder / name for _, name in entries}:
            old.unlink()
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
    return paths


def read_fields(out_dir: str | Path) -> list[Snapshot]:
    """The snapshots that ``write_fields`` left in a run's folder, in order; none where there are none.

    Their travel is that of the blade, and 0 of a run without one; their time is not known. Raises BadInput
    where a file of the series cannot be read."""
    found = []
    for path in sorted((Path(out_dir) / "fields").glob("fields_*.vtu")):
        body, faces = (
            _read(path.with_name(path.name.replace("fields_", kind))) for kind in ("fields_", "faces_")
        )
        blade = _read(path.with_name(path.name.replace("fields_", "blade_")))
        if body is None:
            continue
        names = {f"{name}_{unit}": name for name, unit in _UNITS.items()}
        data = {names.get(name, name): values for name, values in body.point_data.items()}
        travel = 0.0 if blade is None else -float(blade.point_data["displacement_mm"][0, 1])
        cells = body.cells[0]
        found.append(Snapshot(travel, body.points, cells.data, cells.type, data, _by_face(faces)))
    return found


def _read(path: Path) -> meshio.Mesh | None:
    if not path.is_file():
        return None
    try:
        return meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio's readers raise whatever their parsers do, or leave
        raise BadInput(
            file=str(path), key="fields", value=str(error), expected="a file that a run has written"
        ) from error


def _by_face(mesh: meshio.Mesh | None) -> dict[str, dict[str, np.ndarray]]:
    """As ``Snapshot.faces`` has them: in the plane x = 0 lies the cut, and of a split block then its other
    side."""
    if mesh is None:
        return {}
    out, in_plane = {}, iter(("cut", "cut_minus"))
    for number in np.unique(mesh.point_data["face"]):
        own = mesh.point_data["face"] == number
        X = mesh.points[own]
        data = {name: values[own] for name, values in mesh.point_data.items() if name != "face"}
        name = "top" if X[:, 0].any() else next(in_plane)
        out[name] = {"X": X, "x": X + data.pop("displacement_mm"), **data}
    return out


def _times(snapshots: Sequence[Snapshot]) -> list[float]:
    """Of each in a series: travels, in mm, if they rise, else times, in s."""
    # float(): the repr of numpy's own scalars names their type.
    travels = [float(s.displacement_mm) for s in snapshots]
    times = [float(s.time_s) for s in snapshots]
    return travels if np.all(np.diff(travels) > 0) or not np.all(np.diff(times) > 0) else times


def _body(snapshot: Snapshot) -> meshio.Mesh:
    data = {
        f"{name}_{_UNITS[name]}" if name in _UNITS else name: np.ascontiguousarray(values)
        for name, values in snapshot.point_data.items()
    }
    return meshio.Mesh(snapshot.points, [(snapshot.cell_type, snapshot.cells)], point_data=data)


def _faces(snapshot: Snapshot) -> meshio.Mesh | None:
    """All faces' quadrature points as vertices; what one face lacks is nan there."""
    faces = [arrays for arrays in snapshot.faces.values() if len(arrays["X"])]
    if not faces:
        return None
    sizes = [len(arrays["X"]) for arrays in faces]
    points = np.concatenate([arrays["X"] for arrays in faces])
    moved = np.concatenate([arrays["x"] for arrays in faces])
    data = {"displacement_mm": moved - points, "face": np.repeat(np.arange(len(faces)), sizes)}
    for name in dict.fromkeys(name for arrays in faces for name in arrays if name not in ("X", "x")):
        shape = next(np.shape(arrays[name])[1:] for arrays in faces if name in arrays)
        parts = [
            np.asarray(arrays[name], dtype=float) if name in arrays else np.full((size, *shape), np.nan)
            for arrays, size in zip(faces, sizes, strict=True)
        ]
        data[name] = np.concatenate(parts)
    vertices = np.arange(len(points))[:, None]
    return meshio.Mesh(points, [("vertex", vertices)], point_data=data)
