"""Runs of one's own beside the atlas: few of them make it exact where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cutbench.case.case import Case, load_case
from cutbench.emulator import CokrigedCuts, NotInAtlas, OutOfRange, Run
from cutbench.emulator.atlas import shipped
from cutbench.run.sensitivity import extended

#: By this part runs of one's own are stiffer than those of the atlas.
STIFFER = 0.15
FREE = ("G", "G_c", "delta_c")


def gels(count: int, seed: int = 5, blade: str = "contact") -> list[Case]:
    """Cuts of gels like gelatin, at three speeds."""
    rng = np.random.default_rng(seed)
    made = []
    for k in range(count):
        G, G_c, delta_c = np.exp(rng.normal(0, 0.25, 3)) * [5.24, 5.0, 0.07]
        speed = (0.005, 0.02, 0.08)[k % 3]
        made.append(
            load_case(
                "gelatin",
                {
                    "G": f"{G} kPa", "G_c": f"{G_c} J/m^2", "delta_c": f"{delta_c} mm", "depth": "5 mm",
                    "speed": f"{speed} mm/s", "eta_reg": "0.8 s", "with_": blade,
                },
            )
        )  # fmt: skip
    return made


def run(case: Case) -> Run:
    """As the atlas has it, but stiffer, and cut as much later."""
    found = shipped().estimate(replace(case, values={**case.values, "depth": case.values["depth"] * 1.2}))
    x = (1 + STIFFER / 3) * found.x_mm
    return Run(case, x, (1 + STIFFER) * found.force_N, float((1 + STIFFER / 3) * found.onset_mm.value))


def emulator(own: list[Case], asked: list[Case], free=FREE) -> CokrigedCuts:
    return CokrigedCuts([run(case) for case in own], asked[0], asked, free, {})


def off(own: list[Case], asked: list[Case]) -> float:
    """Root mean square of what is predicted less what a run has, over its largest force."""
    made, errors = emulator(own, asked), []
    for case, force in zip(asked, made.forces([case.values for case in asked]), strict=True):
        true = run(case)
        there = np.interp(made.travel(case.values), true.x, true.force)
        errors.append(np.sqrt(np.mean((force - there) ** 2)) / there.max())
    return float(np.mean(errors))


@pytest.mark.parametrize("blade", ["contact", "wedge", "wire"])
def test_six_runs_tell_what_the_atlas_gets_wrong(blade):
    asked = gels(6, 8, blade)
    alone, few = off([], asked), off(gels(6, blade=blade), asked)
    assert alone > 0.05 and few < 0.6 * alone, (alone, few)


def test_a_run_is_exact_where_it_is():
    own = gels(4)
    made, true = emulator(own, own), run(own[0])
    x, force = made.computed(own[0].values)
    assert made.count == 4 and x == pytest.approx(true.x) and force == pytest.approx(true.force)
    assert made.computed(gels(1, seed=9)[0].values) is None
    with_runs, without = (np.linalg.norm(emulator(runs, own).root(own[0].values)) for runs in (own, []))
    assert with_runs < without


def test_a_law_that_does_what_another_value_does_tells_of_that_value():
    own = gels(3)
    tougher = extended(own[0], ["speed_toughness"], {"speed_toughening": 0.5, "toughness_speed": 0.01})
    tougher = replace(tougher, values={**tougher.values, "speed_toughening": 0.5})
    (law,) = (law for law in tougher.model.all if law.name == "speed_toughness")
    plain = replace(own[0], values={**own[0].values, **law.like(tougher.p)})
    true = run(plain)
    made = CokrigedCuts([*map(run, own[1:]), replace(true, case=tougher)], own[0], own, FREE, {})
    assert made.count == 3 and plain.values["G_c"] > 1.1 * own[0].values["G_c"]
    assert made.computed(plain.values)[1] == pytest.approx(true.force)


def test_it_is_the_same_in_every_size():
    own, asked = gels(4), gels(2, seed=8)

    def larger(case: Case) -> Case:
        grown = {n: 10 * case.values[n] for n, q in case.model.parameters().items() if q.unit == "mm"}
        # Ten times the length at the same speed over the same viscosity takes ten times the time.
        return replace(case, values={**case.values, **grown, "G_c": 10 * case.values["G_c"],
                                     "eta_reg": 10 * case.values["eta_reg"]})  # fmt: skip

    plain = emulator(own, asked).forces([c.values for c in asked])
    large = emulator([*map(larger, own)], [*map(larger, asked)])
    assert large.forces([larger(c).values for c in asked]) == pytest.approx(100 * plain, rel=1e-6)


def test_what_no_run_has_told_is_not_said():
    own = gels(4)
    stiffening = extended(own[0], ["fung"], {"b_fung": 0.2})
    asked = [stiffening]
    with pytest.raises(ValueError, match="b_fung"):
        CokrigedCuts([run(c) for c in own], own[0], asked, (*FREE, "b_fung"), {})
    with pytest.raises(OutOfRange):
        emulator(own, own).forces([{**own[0].values, "delta_c": 3.0}])
    with pytest.raises(NotInAtlas):
        CokrigedCuts([], stiffening, asked, FREE, {})
