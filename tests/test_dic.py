"""Measured displacement fields: reading, sampling a run on their grid, errors, strains."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from refusals import refusal, refused
from typer.testing import CliRunner

from cutbench.case.case import load_case
from cutbench.cli.main import app
from cutbench.data.field_comparison import Comparison, at_travel, compare, located, sample, shape, surface
from cutbench.data.fields import Field, read_fields
from cutbench.data.figure import plot_dic
from cutbench.run.result import Snapshot
from cutbench.run.runner import run_case


def bent(X: np.ndarray) -> np.ndarray:
    """A displacement quadratic in X, which six-node triangles hold exactly."""
    x, y = X[..., 0], X[..., 1]
    return np.stack([0.03 * x + 0.002 * x * y, -0.2 - 0.01 * x**2 + 0.004 * y**2], axis=-1)


def section(n: int = 5, width: float = 10.0, height: float = 8.0, low: float = 0.0, u=bent) -> Snapshot:
    """[low, width] × [0, height] in six-node triangles with the displacement ``u``."""
    m = 2 * n + 1
    x, y = np.linspace(low, width, m), np.linspace(0, height, m)
    X = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    cells = []
    for i, j in itertools.product(range(0, 2 * n, 2), repeat=2):

        def at(a, b, i=i, j=j):
            return (i + a) * m + j + b

        cells.append([at(0, 0), at(2, 0), at(0, 2), at(1, 0), at(1, 1), at(0, 1)])
        cells.append([at(2, 2), at(0, 2), at(2, 0), at(1, 2), at(1, 1), at(2, 1)])
    points = np.column_stack([X, np.zeros(len(X))])
    moved = np.column_stack([u(X), np.zeros(len(X))])
    return Snapshot(3.0, points, np.array(cells), "triangle6", {"displacement": moved})


def empty(x, y, configuration="deformed") -> Field:
    return Field(x, y, np.full((2, y.size, x.size), np.nan), np.nan, configuration)


# -- triangles ---------------------------------------------------------------------------------------
@pytest.mark.parametrize("nodes", [3, 6])
def test_shape_functions(nodes):
    r, s = np.array([0.2, 0.5, 0.1]), np.array([0.3, 0.2, 0.8])
    N, dN = shape(r, s, nodes)
    np.testing.assert_allclose(N.sum(axis=1), 1)
    np.testing.assert_allclose(dN.sum(axis=2), 0, atol=1e-14)
    step = 1e-6
    for k, (dr, ds) in enumerate(((step, 0), (0, step))):
        central = (shape(r + dr, s + ds, nodes)[0] - shape(r - dr, s - ds, nodes)[0]) / (2 * step)
        np.testing.assert_allclose(dN[k], central, atol=1e-9)
    corners = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])[:nodes]
    np.testing.assert_allclose(shape(*corners.T, nodes)[0], np.eye(nodes), atol=1e-14)


def test_points_are_found_in_curved_triangles():
    snapshot = section()
    now = snapshot.current[:, :2]
    rng = np.random.default_rng(0)
    cells = rng.integers(len(snapshot.cells), size=200)
    r = rng.uniform(0, 1, 200)
    s = rng.uniform(0, 1, 200) * (1 - r)
    points = np.einsum("pa,pai->pi", shape(r, s, 6)[0], now[snapshot.cells[cells]])
    weights, element = located(now, snapshot.cells, points)
    assert np.all(element >= 0)
    back = np.einsum("pa,pai->pi", weights, now[snapshot.cells[element]])
    np.testing.assert_allclose(back, points, atol=1e-9)
    outside = located(now, snapshot.cells, np.array([[-1.0, 4.0], [5.0, 20.0]]))[1]
    assert list(outside) == [-1, -1]


# -- sampling ----------------------------------------------------------------------------------------
def test_a_quadratic_field_is_met_exactly_in_both_configurations():
    snapshot = section(low=-10.0)
    x, y = np.linspace(-8, 8, 9), np.linspace(0.5, 6.5, 7)
    before = sample(snapshot, empty(x, y, "reference"))
    X = np.stack(np.meshgrid(x, y), axis=-1)
    np.testing.assert_allclose(np.moveaxis(before.u, 0, -1), bent(X), atol=1e-12)
    after = sample(snapshot, empty(x, y))
    # At a place x of the deformed body stands the material of X = x − u, and its u is that of X.
    X = np.moveaxis(after.grid - after.u, 0, -1)
    np.testing.assert_allclose(np.moveaxis(after.u, 0, -1), bent(X), atol=1e-8)


def test_half_a_section_stands_for_its_mirror_image():
    def symmetric(X):
        return np.stack([0.02 * X[..., 0] * X[..., 1], -0.1 - 0.01 * X[..., 0] ** 2], axis=-1)

    x, y = np.linspace(-8, 8, 9), np.linspace(0.5, 6.5, 7)
    half, full = (sample(section(low=low, u=symmetric), empty(x, y)) for low in (0.0, -10.0))
    np.testing.assert_allclose(half.u, full.u, atol=1e-7)


def test_outside_is_masked_and_a_hair_of_opening_is_not():
    x, y = np.linspace(-12, 12, 25), np.linspace(-2, 10, 25)

    def opened(gap):
        return lambda X: np.stack([np.full(X.shape[:-1], gap), np.zeros(X.shape[:-1])], axis=-1)

    hair = sample(section(u=opened(0.01)), empty(x, y)).u[0]
    inside = (np.abs(x)[None] <= 10) & ((y >= 0) & (y <= 8))[:, None]
    np.testing.assert_array_equal(np.isfinite(hair), inside)
    cut = sample(section(u=opened(0.6)), empty(x, y)).u[0]
    assert not np.isfinite(cut[:, 12]).any() and np.isfinite(cut[12, 13])


@pytest.mark.parametrize("nodes", [4, 10])
def test_the_end_face_of_a_block(nodes):
    """A cube of six tetrahedra: sampled is the face at the largest z, whatever lies behind."""
    corners = np.array(list(itertools.product((0.0, 2.0), repeat=3)))
    cells = []
    for order in itertools.permutations(range(3)):
        path = np.zeros((4, 3))
        for k, axis in enumerate(order):
            path[k + 1 :, axis] = 2.0
        cells.append([int(np.flatnonzero((corners == p).all(axis=1))[0]) for p in path])
    points = [*map(tuple, corners)]
    full = []
    for cell in cells:
        more = []
        for a, b in ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)):
            middle = tuple((corners[cell[a]] + corners[cell[b]]) / 2)
            if middle not in points:
                points.append(middle)
            more.append(points.index(middle))
        full.append([*cell, *more][:nodes])
    X = np.array(points)
    u = np.column_stack([0.1 * X[:, 0] * X[:, 2], -0.05 * X[:, 1], 0 * X[:, 0]])
    kind = "tetra" if nodes == 4 else "tetra10"
    block = Snapshot(1.0, X, np.array(full), kind, {"displacement": u})
    assert len(surface(block)[2]) == 2
    x = np.array([0.25, 1.0, 1.75])
    found = sample(block, empty(x, x, "reference"))
    np.testing.assert_allclose(found.u[0], np.broadcast_to(0.2 * x, (3, 3)), atol=1e-12)
    np.testing.assert_allclose(found.u[1], np.broadcast_to(-0.05 * x[:, None], (3, 3)), atol=1e-12)


def test_between_two_snapshots():
    first, second = section(), section()
    first.displacement_mm, second.displacement_mm = 2.9, 3.0
    second.point_data["displacement"] = 2 * first.point_data["displacement"]
    mixed = at_travel([first, second], 2.975)
    np.testing.assert_allclose(mixed.point_data["displacement"], 1.75 * first.point_data["displacement"])
    assert at_travel([first, second], 3.05) is second
    assert at_travel([first, second], 5.0) is None


# -- strains and errors ------------------------------------------------------------------------------
@pytest.mark.parametrize("configuration", ["reference", "deformed"])
def test_strain_of_a_homogeneous_deformation(configuration):
    F = np.array([[1.2, 0.3], [-0.1, 0.8]])
    x = np.linspace(0, 4, 5)
    at = np.stack(np.meshgrid(x, x))
    gradient = F - np.eye(2) if configuration == "reference" else np.eye(2) - np.linalg.inv(F)
    field = Field(x, x, np.einsum("ij,jyx->iyx", gradient, at), np.nan, configuration)
    E = (F.T @ F - np.eye(2)) / 2
    np.testing.assert_allclose(field.strain, np.broadcast_to(E[:, :, None, None], (2, 2, 5, 5)), atol=1e-12)


def test_a_rotation_strains_nothing():
    c, s = np.cos(0.5), np.sin(0.5)
    x = np.linspace(0, 4, 5)
    at = np.stack(np.meshgrid(x, x))
    field = Field(
        x, x, np.einsum("ij,jyx->iyx", np.array([[c - 1, -s], [s, c - 1]]), at), np.nan, "reference"
    )
    np.testing.assert_allclose(field.strain, 0, atol=1e-12)


def test_relative_errors_are_as_stated():
    x = np.arange(4.0)
    computed = Field(x, x, np.stack([np.full((4, 4), 2.0), np.tile(x - 1.5, (4, 1))]))
    measured = Field(x, x, computed.u + np.array([0.5, -0.25])[:, None, None])
    measured.u[:, 0, 0] = np.nan
    found = Comparison(measured, computed)
    error = found.relative_error
    assert np.isnan(error[:, 0, 0]).all() and found.both.sum() == 15
    np.testing.assert_allclose(error[0][found.both], 0.25)
    mean = np.abs(computed.u[1][found.both]).mean()
    np.testing.assert_allclose(error[1][found.both], 0.25 / mean)
    numbers = found.numbers()
    assert numbers["measured"] == numbers["compared"] == 15 and numbers["points"] == 16
    assert numbers["rms_u_x_mm"] == pytest.approx(0.5) and numbers["mean_error_u_x"] == pytest.approx(0.25)


# -- files -------------------------------------------------------------------------------------------
def written(field: Field, travel: float | None = None, head: str = "x [mm],y [mm],u_x [mm],u_y [mm]") -> str:
    rows = [head + ("" if travel is None else ",travel [mm]")]
    for i, j in itertools.product(range(field.y.size), range(field.x.size)):
        u = ["" if np.isnan(v) else repr(float(v)) for v in field.u[:, i, j]]
        cells = [repr(float(field.x[j])), repr(float(field.y[i])), *u]
        rows.append(",".join([*cells, *([] if travel is None else [repr(travel)])]))
    return "\n".join(rows) + "\n"


def test_a_file_of_two_fields(tmp_path):
    x, y = np.linspace(-4, 4, 9), np.linspace(1, 7, 4)
    field = sample(section(low=-10.0), empty(x, y))
    field.u[:, 1, 2] = np.nan
    text = written(field, 3.0) + written(field, 1.5).split("\n", 1)[1]
    path = tmp_path / "dic.csv"
    path.write_text(text, encoding="utf-8")
    early, late = read_fields(path)
    assert (early.travel_mm, late.travel_mm) == (1.5, 3.0)
    np.testing.assert_array_equal(late.u, field.u)
    np.testing.assert_array_equal(late.x, x)
    (alone,) = read_fields_of(tmp_path, written(field), travel_mm=2.0, shift_mm=(1.0, -0.5), y_down=True)
    np.testing.assert_allclose(alone.x, x + 1)
    np.testing.assert_allclose(alone.y, np.sort(-y) - 0.5)
    np.testing.assert_array_equal(alone.u[1], -field.u[1][::-1])
    assert alone.travel_mm == 2.0


def read_fields_of(folder, text, **how):
    path = folder / "one.csv"
    path.write_text(text, encoding="utf-8")
    return read_fields(path, **how)


def test_other_names_and_units(tmp_path):
    x = np.linspace(1, 4, 4)
    field = sample(section(), empty(x, x))
    text = written(field, head="X,Y,U,V")
    columns = {"x": "X", "y": "Y", "u_x": "U", "u_y": "V"}
    (found,) = read_fields_of(tmp_path, text, columns=columns, units=dict.fromkeys(columns, "cm"))
    np.testing.assert_allclose(found.u, 10 * field.u)


BAD = {
    "scattered points": (
        "x [mm],y [mm],u_x [mm],u_y [mm]\n"
        + "".join(f"{a},{a * a % 7},0,0\n" for a in np.linspace(0, 9, 30)),
        "x",
        None,
    ),
    "a point twice": (written(empty(np.arange(3.0), np.arange(3.0))) + "1.0,1.0,,\n", "x, y", 11),
    "no u_y": ("x [mm],y [mm],u_x [mm]\n0,0,0\n", "columns.u_y", 1),
    "no unit": (written(empty(np.arange(3.0), np.arange(3.0)), head="x,y,u_x,u_y"), "x", 1),
    "a blank position": ("x [mm],y [mm],u_x [mm],u_y [mm]\n0,,0,0\n", "y", 2),
}


@pytest.mark.parametrize("name", BAD)
def test_refused(name, tmp_path):
    text, key, line = BAD[name]
    with refused(key, line=line, file="one.csv"):
        read_fields_of(tmp_path, text)


def test_fields_that_do_not_meet_the_body_are_refused():
    far = empty(np.linspace(50, 60, 5), np.linspace(0, 5, 5))
    far.u[:] = 0.0
    with refused("x, y"):
        compare(far, section())
    with refused("travel", value="9 mm"):
        compare(Field(far.x, far.y, far.u, 9.0), section())
    with refused("configuration", value="deformd", hint="'deformed'"):
        Field(far.x, far.y, far.u, np.nan, "deformd")


# -- a run -------------------------------------------------------------------------------------------
CHANGES = {"h": "0.7 mm", "depth": "1 mm"}


@pytest.fixture(scope="module")
def run():
    return run_case(load_case("elastomer", CHANGES), snapshots_mm=[1.0])


@pytest.mark.slow
def test_a_run_beside_itself(run, tmp_path):
    (snapshot,) = run.snapshots
    field = sample(snapshot, empty(np.linspace(-12, 12, 25), np.linspace(10, 20, 11)))
    field = Field(field.x, field.y, field.u + 0.001, 1.0)
    path = tmp_path / "dic.csv"
    path.write_text(written(field, 1.0), encoding="utf-8")
    args = ["dic", "elastomer", str(path), "--h", "0.7", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, args)
    assert done.exit_code == 0, done.output
    (numbers,) = json.loads((tmp_path / "out" / "dic.json").read_text(encoding="utf-8"))["fields"]
    assert numbers["rms_u_x_mm"] == pytest.approx(0.001, rel=1e-3)
    assert numbers["rms_u_y_mm"] == pytest.approx(0.001, rel=1e-3)
    assert numbers["rms_E_xx"] < 1e-6 and numbers["compared"] == numbers["measured"] > 200
    rows = (tmp_path / "out" / "dic.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 1 + 25 * 11
    assert (tmp_path / "out" / "dic_1.000mm.png").stat().st_size > 20_000


def test_a_picture_of_little(run):
    """One field far from the cut, without a travel: drawn all the same."""
    field = sample(run.snapshots[0], empty(np.linspace(4, 8, 5), np.linspace(2, 8, 4), "reference"))
    figure = plot_dic(
        compare(Field(field.x, field.y, field.u, np.nan, "reference"), run.snapshots[0]), "little"
    )
    assert len(figure.axes) == 15 + 10


@pytest.mark.parametrize(
    ("option", "wanted"),
    [
        (["--shift", "1"], "--shift"),
        (["--shift", "a,b"], "--shift"),
        ([], "travel"),
        (["--travel", "0"], "travel"),
        (["--travel", "100"], "depth"),
    ],
)
def test_bad_options(option, wanted, tmp_path):
    path = tmp_path / "dic.csv"
    path.write_text(written(empty(np.arange(3.0), np.arange(3.0))), encoding="utf-8")
    done = CliRunner().invoke(app, ["dic", "elastomer", str(path), *option, "--out", str(tmp_path / "out")])
    refusal(done, wanted)
