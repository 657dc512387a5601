"""Blades by profile, beyond what every law is held to: shapes, both dimensions, files, what is refused."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from coarse_runs import QUICK
from form_checks import DEFAULT, P, blade, blade_case, check_tangent, space_of
from refusals import refused

from cutbench.base.errors import BadInput
from cutbench.case.case import Case, load_case
from cutbench.case.model import Model
from cutbench.forms.base import Step
from cutbench.mechanisms import registry
from cutbench.run.blade_geometry import blade_outline
from cutbench.run.build import build, geometry_of
from cutbench.run.runner import run_case

SHAPES = ("wedge", "bevel", "wire", "measured_outline")
#: Edges so round that a coarse mesh takes them.
ROUND = SimpleNamespace(
    **vars(P), angle=np.radians(40), bevel_angle=np.radians(30), edge_radius=0.1, shoulder=0.3
)


def tool(name: str):
    return registry()[name]


def test_a_wedge_is_where_its_drawing_has_it():
    p = SimpleNamespace(thickness=2.0, angle=np.radians(60), edge_radius=0.1, shoulder=0.5)
    # A flank at 30 degrees, moved out by the radius from the edge's centre (0, r).
    up = np.array([np.sin(np.radians(30)), np.cos(np.radians(30))])
    out = np.array([np.cos(np.radians(30)), -np.sin(np.radians(30))])
    at = np.array([0.0, 0.1]) + 0.7 * up + (0.1 + 0.25) * out
    g, n, H = tool("wedge").distance(at[:1], at[1:], p)
    assert g[0] == pytest.approx(0.25, abs=1e-14) and n[:, 0] == pytest.approx(out, abs=1e-14)
    assert np.abs(H).max() == 0
    # Below the edge, beside the band, and inside, nearest to a flank.
    g, n, _ = tool("wedge").distance(np.array([0.0, -1.4, 0.3]), np.array([-0.2, 9.0, 9.0]), p)
    assert g == pytest.approx([0.2, 0.4, -0.7], abs=1e-14)
    assert n[0] == pytest.approx([0, -1, 1], abs=1e-14)


def test_a_bevel_is_ground_on_the_right():
    p = SimpleNamespace(thickness=1.0, bevel_angle=np.radians(20), edge_radius=0.02, shoulder=0.2)
    g, n, _ = tool("bevel").distance(np.array([-0.3, 1.5, 0.1, -0.0]), np.array([1.0, 9.0, 9.0, 2.0]), p)
    assert g == pytest.approx([0.28, 1.5 - 0.98, 0.1 - 0.98, -0.02], abs=1e-12)
    assert n[0] == pytest.approx([-1, 1, 1, -1])
    assert tool("bevel").extent(p) == pytest.approx((-0.02, 0.98, np.inf))


def test_a_wire_is_a_circle():
    p, r = SimpleNamespace(thickness=0.3), np.random.default_rng(3)
    x, y = r.uniform(-1, 1, (2, 200))
    g, n, H = tool("wire").distance(x, y, p)
    away = np.hypot(x, y - 0.15)
    assert g == pytest.approx(away - 0.15, abs=1e-14)
    assert n == pytest.approx(np.stack([x, y - 0.15]) / away, abs=1e-12)
    assert H[0, 0] + H[1, 1] == pytest.approx(1 / away, rel=1e-9)


@pytest.mark.parametrize("flanks", ["both", "right", "left"])
def test_a_measured_ellipse_is_the_ellipse(flanks, tmp_path):
    first, last = {"both": (-np.pi, 0), "right": (-np.pi / 2, 0), "left": (-np.pi, -np.pi / 2)}[flanks]
    t = np.linspace(first, last, 200)
    line = np.column_stack([0.35 * np.cos(t), 3 + 1.05 * np.sin(t)])[:: -1 if flanks == "left" else 1]
    rows = "\n".join(f"{x!r},{y!r}" for x, y in line.tolist())
    (tmp_path / "blade.csv").write_text(f"x_mm,y_mm\n{rows}\n", encoding="utf-8")
    case = load_case("gelatin", {"with": "measured_outline", "outline": str(tmp_path / "blade.csv")})
    assert case.p.thickness == pytest.approx(0.7)
    x, y = np.random.default_rng(4).uniform([[-1], [-1]], [[1], [2]], (2, 300))
    ellipse = SimpleNamespace(thickness=0.7, tip=1.05)
    wanted, measured = tool("contact").distance(x, y, ellipse), case.model.tool.distance(x, y, case.p)
    outside = wanted[0] > 0
    assert measured[0][outside] == pytest.approx(wanted[0][outside], abs=2e-4)
    assert np.abs(measured[1] - wanted[1])[:, outside].max() < 5e-3
    assert case.model.tool.edge_radius(case.p) == pytest.approx(0.35**2 / 1.05, rel=0.02)
    assert case.model.tool.alike(case.p) == (flanks != "both")


@pytest.mark.parametrize("name", (*SHAPES, "contact", "blunt_tip"))
def test_a_distance_is_the_same_in_complex_numbers(name):
    """Those go through NumPy, real numbers through compiled loops where there are any."""
    p = SimpleNamespace(**vars(ROUND) | {"blunting": 0.5})
    r = np.random.default_rng(7)
    x, y = r.uniform(-0.6, 0.6, 2000), r.uniform(-0.3, 2.0, 2000)
    for real, other in zip(tool(name).distance(x, y, p), tool(name).distance(x + 0j, y, p), strict=True):
        assert np.iscomplexobj(other) and np.abs(other).max() > 0
        np.testing.assert_allclose(real, other.real, rtol=0, atol=1e-12 * np.abs(other).max())


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("name", SHAPES)
def test_blade_tangent(name, dim):
    space = space_of(dim, 2)
    form = blade(space, names=Model(DEFAULT).with_(name).mechanisms)
    u, state, step = blade_case(space, form, ROUND)
    pressed = form.evaluate(u, ROUND, state, step).state["pressure"] > 0
    assert pressed.any() and not pressed.all()
    check_tangent(space, form, u, state, step, ROUND, rtol=1e-9)


CASES = {
    "wedge": {"with_": "wedge", "angle": "40 deg", "edge_radius": "0.05 mm"},
    "bevel": {"with_": "bevel", "bevel_angle": "30 deg", "edge_radius": "0.05 mm"},
    "wire": {"with_": "wire", "thickness": "0.3 mm", "cohesion": 0.25},
}


def made(name: str, **changes) -> Case:
    return QUICK.set(**CASES[name]).set(**{"depth": "0.6 mm", **changes})


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if n == "wire" else ()) for n in CASES]
)
def test_a_blade_of_each_profile_cuts(name):
    result = run_case(made(name, depth="1.4 mm"))
    assert result.outcome.done, str(result.outcome)
    assert result.force_N[-1] > 0 and np.isfinite(result.force_N).all()
    assert result.measures["onset_mm"] < 1.4
    assert abs(result.measures["closure"]) < 0.05


def test_both_halves_are_twice_the_half():
    half, full = (run_case(made("wedge", symmetry=part)) for part in ("half", "full"))
    assert full.force_N[-1] == pytest.approx(half.force_N[-1], rel=1e-3)


def test_a_bevel_has_its_whole_section_meshed_and_pushes_aside():
    assert geometry_of(made("bevel")).split and not geometry_of(made("wedge")).split
    assert geometry_of(Case(**vars_of(made("bevel"), dim=3))).split
    with refused("symmetry", value="half", hint="'auto'"):
        made("bevel", symmetry="half")


def vars_of(case: Case, **changes) -> dict:
    names = ("name", "dim", "mechanisms", "values", "numerics")
    return {name: getattr(case, name) for name in names} | changes


def test_elements_under_a_sharp_edge_are_smaller():
    def smallest(**changes):
        case = load_case("gelatin", {"h": "0.25 mm", "with": "wedge", **changes})
        mesh = geometry_of(case).mesh
        top = np.abs(mesh.p[1] - case.p.height) < 1e-9
        return np.diff(np.sort(mesh.p[0, top])).min()

    assert smallest(edge_radius="0.02 mm") < smallest(edge_radius="0.15 mm")
    assert smallest(edge_radius="0.15 mm", corner=0.25) == smallest(edge_radius="0.02 mm", corner=0.25)


def test_pictures_show_the_profile():
    wire = blade_outline(made("wire"), 2.0, 25.0)
    assert wire[:, 1].max() == pytest.approx(21 - 2 + 0.3) and wire[0] == pytest.approx(wire[-1])
    wedge = blade_outline(made("wedge"), 2.0, 25.0)
    assert wedge[:, 1].min() == pytest.approx(19) and wedge[[0, -1], 1] == pytest.approx(25)


MEASURED = {"with": "measured_outline"}
REFUSED = {
    "the paper's gap": ({"with": "wedge", "numerics": "paper"}, "gap", "distance"),
    "an edge thicker than its blade": ({"with": "wedge", "edge_radius": "1 mm"}, "edge_radius", "less than"),
    "a shoulder without room": ({"with": "bevel", "shoulder": "60 mm"}, "shoulder", "less than"),
    "an edge that no element sees": ({"with": "wedge", "h": "0.5 mm"}, "edge_radius", "h = "),
    "a thin wire on a coarse mesh": (
        {"with": "wire", "thickness": "0.01 mm", "h": "0.2 mm"}, "h", "beside"
    ),
    "no outline": (MEASURED, "outline", "CSV"),
    "no such file": (MEASURED | {"outline": "nowhere.csv"}, "outline", "CSV"),
    "an outline for another blade": ({"outline": [[0, 0], [1, 1]]}, "outline", "measured_outline"),
    "too few points": (MEASURED | {"outline": [[-1, 1], [0, 0], [1, 1]]}, "outline", "5 points"),
    "a point twice": (MEASURED | {"outline": [[-1, 1], [0, 0], [0, 0], [1, 1], [1, 2]]}, "outline", "differ"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_refused(name):
    changes, key, expected = REFUSED[name]
    with pytest.raises(BadInput) as error:
        load_case("gelatin", changes)
    assert error.value.key == key and expected in str(error.value)


@pytest.mark.parametrize("text", ["x,y\n0,0\n", "x_mm,y_mm\n0,zero\n", "x_mm,y_mm\n1,2,3\n", ""])
def test_a_file_that_is_no_outline_is_named(text, tmp_path):
    (tmp_path / "blade.csv").write_text(text, encoding="utf-8")
    with refused("outline"):
        load_case("gelatin", {"with": "measured_outline", "outline": str(tmp_path / "blade.csv")})


def test_an_outline_is_part_of_the_case(tmp_path):
    """By its content, in case files relative to them, and in the case's own record."""
    x = np.linspace(0, 0.35, 50)

    def write(steep):
        rows = "\n".join(f"{a},{b}" for a, b in zip(x, steep * (np.sqrt(x**2 + 0.01) - 0.1), strict=True))
        (tmp_path / "blade.csv").write_text(f"x_mm,y_mm\n{rows}\n", encoding="utf-8")

    (tmp_path / "case.toml").write_text(
        'base = "gelatin"\nmechanisms = ["neo_hookean", "volumetric", "smith_ferrante", "measured_outline"]\n'
        '[blade]\noutline = "blade.csv"\n',
        encoding="utf-8",
    )
    write(2.0)
    first = load_case(tmp_path / "case.toml")
    assert first.id == load_case(tmp_path / "case.toml").id == Case.from_dict(first.to_dict()).id
    write(2.1)
    assert load_case(tmp_path / "case.toml").id != first.id
    assert first.p.thickness == pytest.approx(0.7) and first.set(thickness="0.3 mm").outline == first.outline
    assert not first.set(with_="wedge").outline


# -- pre-cut ---------------------------------------------------------------------------------------
PRECUT = QUICK.set(precut="2 mm", depth="1.1 mm")


@pytest.mark.parametrize("dim", [2, 3])
def test_a_pre_cut_is_cut_to_its_depth(dim):
    mesh = {"h": "2 mm", "corner": 1.0} if dim == 3 else {}
    built = build(load_case("gelatin", {"precut": "5 mm", **mesh}, dim=dim))
    cut = built.form("cohesion")
    state = cut.start(built.problem.p)
    depth = 21 - cut.faces.X[1].ravel()
    assert np.array_equal(state["damage"], np.where(depth < 5, 1.0, 0.0))
    jump = np.zeros((3, depth.size))
    for opening, carries in ((0.01, depth >= 5), (-0.001, depth > -1)):
        jump[0] = opening
        T, _ = cut.laws[0].traction(jump, built.problem.p, state, cut.points(at_rest(built)))
        assert np.array_equal(np.abs(T[0]) > 1e-9, carries), "shut alone it carries"


def at_rest(built):
    u = np.zeros(built.problem.ndof)
    return Step(1.0, u, np.zeros(3), np.zeros(3))


@pytest.mark.slow
def test_a_run_begins_with_its_pre_cut():
    whole, cut = run_case(QUICK), run_case(PRECUT)
    assert cut.outcome.done
    lengths = cut.curve["cut_length_mm"]
    assert lengths[0] == pytest.approx(2, abs=0.1) and whole.curve["cut_length_mm"][0] == 0
    assert np.diff(lengths).min() >= 0
    assert whole.measures["onset_mm"] < 1.1 and np.isnan(cut.measures["onset_mm"]), "nothing was cut further"
    assert cut.force_N.max() < whole.force_N.max()
    (cohesive,) = (law.name for law in QUICK.model.laws("cut") if law.role == "cohesive")
    spent = [run.curve[f"work_{cohesive}_mJ"][-1] for run in (cut, whole)]
    assert spent[0] < 0.2 * spent[1]


def test_a_pre_cut_as_deep_as_the_specimen_is_refused():
    with refused("precut", value="21 mm"):
        load_case("gelatin", {"precut": "21 mm"})
    with refused("precut", value="2 mm", hint="cohesive"):
        load_case("gelatin", {"precut": "2 mm", "mechanisms": "neo_hookean, volumetric, contact"})
