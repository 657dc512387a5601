"""A case: identity, units, groups, round trips."""

from __future__ import annotations

import json
import pickle
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest
from coarse_runs import tuned
from hypothesis import given
from hypothesis import strategies as st
from refusals import refused

import cutbench
from cutbench import run2d
from cutbench.base.errors import BadInput
from cutbench.case.case import Case, Numerics, load_case
from cutbench.case.model import DEFAULT, PAPER, Model
from cutbench.mechanisms import registry

positive = st.floats(1e-3, 1e3)


@pytest.fixture(scope="module")
def gelatin() -> Case:
    return load_case("gelatin")


def test_values_are_internal(gelatin):
    assert gelatin.p.G == 7.5e-3
    assert gelatin.p.G_c == 5.3e-3
    assert gelatin.p.tau_W == 0.8e-3
    assert gelatin.p.height == 21.0
    assert set(gelatin.values) == set(gelatin.model.parameters())


@pytest.mark.parametrize(
    ("key", "one", "other"),
    [
        ("G", "0.12 MPa", "120 kPa"),
        ("G_c", "15 J/m^2", "0.015 N/mm"),
        ("delta_c", "70 um", "0.07 mm"),
        ("speed", "1.26 mm/min", "0.021 mm/s"),
        ("width", "3 cm", "30 mm"),
        ("h", "300 um", "0.3 mm"),
    ],
)
def test_the_unit_of_writing_does_not_change_the_id(gelatin, key, one, other):
    assert gelatin.set(**{key: one}).id == gelatin.set(**{key: other}).id


def test_a_value_at_its_bound_is_read_back():
    block = load_case("gelatin", {"tilt": "30 deg"}, dim=3)
    assert Case.from_dict(block.to_dict()) == block
    with pytest.raises(BadInput):
        block.set(tilt="30.001 deg")


@given(G=positive, speed=positive, h=st.floats(0.15, 0.4))
def test_round_trip(G, speed, h):
    case = load_case("gelatin", {"G": f"{G!r} kPa", "speed": f"{speed!r} um/min", "h_mm": h})
    back = Case.from_dict(json.loads(json.dumps(case.to_dict())))
    assert back == case
    assert back.id == case.id
    assert pickle.loads(pickle.dumps(case)) == case


def test_id_sees_what_matters_and_nothing_else(gelatin):
    values = dict(reversed(gelatin.values.items()))
    mechanisms = tuple(reversed(gelatin.mechanisms))
    same = Case(name="another name", dim=2, mechanisms=mechanisms, values=values, numerics=Numerics())
    assert same.id == gelatin.id
    others = [
        gelatin.set(G="7.500001 kPa"),
        gelatin.set(h="0.3 mm"),
        gelatin.set(element="P1"),
        gelatin.set(without="coulomb"),
        gelatin.set(with_="viscous"),
        load_case("gelatin", dim=3),
    ]
    assert len({gelatin.id, *(case.id for case in others)}) == 1 + len(others)


@pytest.mark.parametrize(
    ("part", "changes"),
    [("steps", {"calm": 0.3}), ("newton", {"chord": 0.4}), ("window", {"caution": (1.0, 0.5)}),
     ("remesh", {"worth": 0.6}), ("path", {"leaps": (0.1,)}),
     ("mesh", {"corner": (0.1, 0.01)})],
)  # fmt: skip
def test_id_sees_every_tuned_number_and_a_file_keeps_them(gelatin, part, changes):
    other = tuned(gelatin, part, **changes)
    assert other.id != gelatin.id
    again = Case.from_dict(json.loads(json.dumps(other.to_dict())))
    assert again == other and again.numerics.tuning == other.numerics.tuning


def test_id_is_the_same_in_another_process(gelatin):
    code = "from cutbench import load_case; print(load_case('gelatin').id)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == gelatin.id


def test_id_follows_the_content_of_a_mesh(gelatin, tmp_path):
    mesh = tmp_path / "a.msh"
    mesh.write_text("one", encoding="utf-8")
    first = gelatin.set(mesh=str(mesh)).id
    copy = tmp_path / "b.msh"
    copy.write_text("one", encoding="utf-8")
    assert gelatin.set(mesh=str(copy)).id == first
    copy.write_text("two", encoding="utf-8")
    assert gelatin.set(mesh=str(copy)).id != first


GROUPS = {k: g for k, g in load_case("elastomer").model.settable_groups().items() if g.unit == "1"}


@given(value=st.floats(0.05, 20), name=st.sampled_from(sorted(GROUPS)))
def test_a_group_takes_the_value_it_is_set_to(value, name):
    case = load_case("elastomer", {name: value, "h": "0.002 mm"})
    assert GROUPS[name].value(case.p) == pytest.approx(value, rel=1e-12)
    assert case.groups()[GROUPS[name].text] == pytest.approx(value, rel=1e-12)
    untouched = set(case.values) - {GROUPS[name].parameter}
    before = load_case("elastomer")
    assert all(case.values[key] == before.values[key] for key in untouched)


def test_all_groups_at_once_whatever_their_order():
    wanted = {
        "adhesion": 0.2,
        "viscosity": 1.5,
        "cohesion": 9.0,
        "sharpness": 4.0,
        "friction": 0.3,
        "opening": 0.1,
    }
    one = load_case("meat", wanted)
    other = load_case("meat", dict(reversed(wanted.items())))
    assert one.id == other.id
    for name, value in wanted.items():
        assert GROUPS[name].value(one.p) == pytest.approx(value, rel=1e-12)


def test_groups_are_solved_after_the_parameters(gelatin):
    case = gelatin.set(cohesion=9.0, G="20 kPa")
    assert case.p.G_c == pytest.approx(9.0 * 20e-3 * 0.07)
    kept = gelatin.set(cohesion=9.0).set(G="20 kPa")
    assert kept.p.G_c == pytest.approx(9.0 * 7.5e-3 * 0.07), "a group set earlier is not remembered"


def test_pseudo_time_is_a_conversion(gelatin):
    assert gelatin.set(eta_v="0.05 mm").p.eta_reg == pytest.approx(0.05 / 0.021)
    assert gelatin.set(eta_v="0.05 mm", speed="1 mm/s").p.eta_reg == pytest.approx(0.05)


def test_the_blade_stops_before_the_clamp_until_its_depth_is_chosen(gelatin):
    assert gelatin.p.depth == pytest.approx(21 - 4 * 0.7)
    assert gelatin.set(height="30 mm").p.depth == pytest.approx(30 - 4 * 0.7)
    assert gelatin.set(thickness="1 mm").p.depth == pytest.approx(21 - 4)
    assert gelatin.set(height="3 mm").p.depth == 1.5
    assert gelatin.set(depth="14 mm").set(height="30 mm").p.depth == 14


def test_the_blade_goes_no_further_than_the_base(gelatin):
    assert gelatin.set(depth="21 mm").p.depth == 21
    with refused("depth", value="21.1 mm"):
        gelatin.set(depth="21.1 mm")


@pytest.mark.parametrize(
    "changes",
    [
        {"without": "contact", "depth": "0.1 mm", "h": "0.7 mm"},
        {"without": ["contact", "adhesion", "coulomb"], "depth": "0.1 mm", "h": "0.7 mm"},
    ],
)
def test_a_cut_without_a_blade_is_refused(changes):
    with refused("mechanisms"):
        run2d("gelatin", **changes)


SLIPS = {
    "a time of another speed": (
        {"G": "12 kPa", "G_c": "4 J/m^2", "thickness": "1 mm", "speed": "5 mm/s"},
        ["eta_reg v/delta_c"], ("= 170", "0.015 to 2.85", "eta_reg", "speed"),
    ),
    "Pa for kPa": ({"G": "7.5 Pa"}, ["(G_c/delta_c)/G", "G_c/(G a)"], ("1.79 to 41.1", "units of G")),
    "um for mm": (
        {"delta_c": "0.07 um"}, ["(G_c/delta_c)/G", "delta_c/a", "eta_reg v/delta_c"], ("0.0002", "delta_c")
    ),
    "MPa for kPa": ({"tau_W": "0.8 MPa"}, ["tau_W/(G_c/delta_c)"], ("0 to 0.187", "tau_W")),
    "of another law": (
        {"with": "compact_cohesion", "G": "7.5 MPa"}, ["(G_c/delta_c)/G", "G_c/(G a)"], ("below",)
    ),
}  # fmt: skip


@pytest.mark.parametrize("slip", SLIPS)
def test_groups_far_from_the_known_materials_are_doubted(gelatin, slip):
    changes, groups, said = SLIPS[slip]
    case = gelatin.set(**changes)
    assert [one.group for one in case.far] == groups
    assert case.doubts[len(case.cautions) :] == tuple(map(str, case.far))
    for part in said:
        assert part in " ".join(case.doubts)


@pytest.mark.parametrize(
    "changes",
    [
        {}, {"nu": 0.4999}, {"mu": 1.5}, {"eta_reg": "0 s"}, {"eta_v": "0.001 mm"}, {"tau_W": "0.001 kPa"},
        {"G": "3 kPa"}, {"cohesion": 0.7}, {"speed": "0.2 mm/s"}, {"with": "gent"},
    ],
)  # fmt: skip
def test_other_materials_are_not(gelatin, changes):
    assert not gelatin.set(**changes).doubts


@pytest.mark.parametrize("name", ["gelatin", "elastomer", "meat"])
@pytest.mark.parametrize("dim", [2, 3])
def test_nor_are_the_known_ones(name, dim):
    assert not load_case(name, dim=dim).doubts


def test_elements_larger_than_the_tip_is_round_are_doubted_along_its_normal(gelatin):
    assert not gelatin.doubts
    assert not gelatin.set(h="1 mm", corner=0.11, shallow=1).doubts
    assert not gelatin.set(h="1 mm", corner=0.25, shallow=0.11).doubts
    coarse = gelatin.set(h="1 mm", corner=0.25)
    (said,) = coarse.doubts
    assert "0.25 mm" in said and "0.117 mm" in said
    advised = re.search(r"corner = (\S+) or normal = '(\w+)'", said)
    assert not coarse.set(corner=float(advised[1])).doubts
    assert not coarse.set(normal=advised[2]).doubts


def test_a_contact_that_gives_way_by_much_of_the_edge_is_doubted():
    assert not load_case("gelatin_recalibrated").doubts
    soft = load_case("gelatin_recalibrated", {"penalty": 1000})
    (said,) = soft.doubts
    advised = re.search(r"penalty = (\d+) would do", said)
    assert not soft.set(penalty=float(advised[1])).doubts


@pytest.mark.parametrize("name", ["corner", "shallow"])
def test_sizes_that_are_chosen_are_0_and_no_mesh_is_endless(gelatin, name):
    assert getattr(gelatin.set(**{name: 0}).numerics, name) == 0
    with refused(name, hint="0.0"):
        gelatin.set(**{name: 1e-4})


def test_a_case_does_not_change(gelatin):
    with pytest.raises(TypeError):
        gelatin.values["G"] = 1.0
    before = gelatin.id
    gelatin.set(G="9 kPa")
    assert gelatin.id == before


def test_overrides_as_texts_or_mapping():
    assert load_case("meat", ["eta_reg=0.5 s", "h=0.3 mm"]) == load_case(
        "meat", {"eta_reg": "0.5 s", "h_mm": 0.3}
    )


def test_an_override_may_give_what_a_file_leaves_out(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text('[parameters]\nG = "9 kPa"\ndelta_c = "0.07 mm"\n', encoding="utf-8")
    with refused("G_c", value="(missing)"):
        load_case(file)
    assert load_case(file, {"G_c": "5 J/m^2"}).p.G_c == 5e-3
    assert load_case(file, {"cohesion": 10.0}).groups()["(G_c/delta_c)/G"] == pytest.approx(10)


def test_a_group_needs_what_it_is_solved_from(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[parameters]\ncohesion = 9.0\n", encoding="utf-8")
    with refused("cohesion", value="9.0", line=2):
        load_case(file)


def test_a_file_on_a_base(tmp_path, gelatin):
    file = tmp_path / "soft.toml"
    file.write_text(
        'base = "gelatin"\nmechanisms = ["neo_hookean", "volumetric", "smith_ferrante", "contact"]\n'
        '[parameters]\nG = "5 kPa"\n[numerics]\nelement = "P1"\n',
        encoding="utf-8",
    )
    case = load_case(file)
    assert (case.name, case.p.G, case.p.G_c) == ("soft", 5e-3, gelatin.p.G_c)
    assert case.numerics.element == "P1"
    assert "mu" not in case.values


def test_a_mesh_is_found_beside_its_file(tmp_path):
    (tmp_path / "block.msh").write_text("mesh", encoding="utf-8")
    file = tmp_path / "case.toml"
    file.write_text('base = "gelatin"\n[numerics]\nmesh = "block.msh"\n', encoding="utf-8")
    assert load_case(file).numerics.mesh == str(tmp_path / "block.msh")


def test_models_do_not_depend_on_the_order_of_names():
    assert Model(tuple(reversed(DEFAULT))) == Model(DEFAULT)
    whole = Model(PAPER).with_("viscous_degraded", "stiff_cohesion", "surface_gradient")
    assert set(whole.mechanisms) == set(DEFAULT)


def test_with_replaces_what_has_the_role():
    model = Model(DEFAULT).with_("viscous")
    assert "viscous" in model.mechanisms
    assert "viscous_degraded" not in model.mechanisms
    assert model.with_("viscous") == model


@pytest.mark.parametrize("name", [n for n in DEFAULT if n != "neo_hookean"])
def test_each_mechanism_can_be_taken_out_alone(name, gelatin):
    case = gelatin.set(without=name)
    assert name not in case.mechanisms
    reads = {key for m in case.model.all for key in m.reads}
    assert reads <= set(case.values)
    assert case.groups(), "groups of the others can still be computed"


def test_laws_come_in_the_order_of_rank():
    for slot in ("bulk", "cut", "blade"):
        ranks = [m.rank for m in Model(DEFAULT).laws(slot)]
        assert ranks == sorted(ranks)
        assert ranks, slot


@pytest.mark.parametrize("name", list(registry()))
def test_every_mechanism_can_be_put_into_the_default_model(name):
    model = Model(DEFAULT).with_(name)
    p = SimpleNamespace(**{k: q.typical * q.factor for k, q in model.parameters().items()})
    assert name in model.mechanisms
    assert all(isinstance(value, float) for value in model.groups(p).values())


def test_api():
    published = {"elastomer", "gelatin", "meat"}
    assert set(cutbench.known_materials()) == published | {f"{name}_recalibrated" for name in published}
    assert set(DEFAULT) <= set(cutbench.known_mechanisms())
    assert cutbench.load_case is load_case
    with pytest.raises(AttributeError, match="nothing"):
        _ = cutbench.nothing


def test_first_looks_have_fewer_elements_softer_contact_and_blocks_their_own():
    quick, usual = (load_case("gelatin", {"numerics": word}).numerics for word in ("fast", "converged"))
    assert usual == Numerics()
    assert quick.h > usual.h and quick.penalty < usual.penalty
    block, look = (load_case("gelatin", {"numerics": word}, dim=3).numerics for word in ("converged", "fast"))
    assert block.h == quick.h and block.penalty < quick.penalty
    assert look.h > block.h and look.layers < block.layers
