"""How long the next step is: what is refused, and what the next one is made for."""

from dataclasses import replace

import numpy as np
import pytest
from coarse_runs import BRIEF

from cutbench.run.build import build
from cutbench.solver.march import Given
from cutbench.solver.newton import NoConvergence
from cutbench.solver.step_control import SETTLES, EnergyError, StepControl, StepRules, StepState


def test_where_errors_add_up_their_mean_counts():
    """A step may leave twice as much open as steps are to on average, but never more than any step may."""
    control, now = StepControl(StepRules(defect=0.04), False), StepState(0.05)
    drifting, allowed = (control.allowed(0.05, 1.0, 0.1, 1.0, before) for before in (0.1, -0.1))
    # Of the work of a whole step of 0.1 mm.
    assert (drifting, allowed) == (pytest.approx(2 * control.rules.drift / 2), 0.04)
    control.check(now, 0.1, 1.9 * drifting, drifting)
    control.check(now, 0.1, 0.039, allowed)
    for defect, limit in ((2.1 * drifting, drifting), (0.041, allowed)):
        with pytest.raises(EnergyError):
            control.check(now, 0.1, defect, limit)


def test_a_blade_at_rest_may_leave_as_much_open_as_in_its_largest_step():
    control = StepControl(StepRules(defect=0.1), True)
    rest, large, small = (control.allowed(size, 1.0, 0.1, 1.0, 0.1) for size in (0.0, 0.1, 0.01))
    assert rest == large > small


def test_the_next_step_is_shorter_where_the_cut_hastens():
    sizes = []
    for growth in (0.3, 0.9):
        control = StepControl(StepRules(largest=1.0, damage=0.5), False)
        sizes.append(control.after(StepState(0.02, easy=3), 2, growth, 0.0, 0.05).size)
    assert sizes[0] > 0.02 > sizes[1]


def test_before_the_cut_has_begun_damage_grows_by_less_in_a_step():
    rules = StepRules(largest=1.0, damage=0.5)
    control, now, growth = StepControl(rules, False), StepState(0.02, easy=3, rate=2.0), 0.3
    begun, whole = (growth, 0.0), (0.0, growth)
    sizes = [control.after(now, 2, at, 0.0, 0.05, nascent).size for at, nascent in (begun, whole)]
    assert sizes[0] > 0.02 > sizes[1]
    control.check(now, growth, 0.0, 0.05)
    with pytest.raises(NoConvergence, match="damage grew"):
        control.check(now, 0.0, 0.0, 0.05, nascent=growth)


def test_what_breaks_in_a_jump_is_not_damped_for_that():
    """However short steps are, the front breaks an element at once: then they are taken as they are."""
    control = StepControl(StepRules(damage=0.1), True)
    control.check(StepState(control.rules.finest), 0.9, 0.0, 0.05)
    with pytest.raises(NoConvergence, match="damage grew"):
        control.check(StepState(2 * control.rules.finest), 0.9, 0.0, 0.05)


def test_what_grows_exponentially_is_followed():
    """A step is a part of the way over which damage grows e times faster, however little it grows."""
    rules = StepRules(largest=1.0, damage=1.0)
    control, length, way = StepControl(rules, False), 0.01, 0.03
    now = StepState(length, easy=3, rate=0.0)
    for times in (1.0, np.exp(length / way)):
        now = control.after(now, 2, 0.0, 0.0, 0.05, nascent=0.02 * times)
        now = replace(now, size=length) if times == 1 else now
    assert now.size == pytest.approx(min(rules.resolved * way, rules.grow * length))


def test_a_cut_has_begun_where_faces_are_apart():
    march = build(BRIEF).march
    states = march.problem.start()
    assert march.whole(states).all()
    damage = np.where(march.problem.cut.faces.X[1].ravel() > BRIEF.p.height - 0.5, 1.0, 0.2)
    assert not march.whole({"cohesion": {**states["cohesion"], "damage": damage}}).any()


def test_after_a_jump_the_way_goes_on_as_over_it_but_rates_begin_anew():
    march = build(BRIEF).march
    *_, jumped = march.steps(given=[*[Given(0.02)] * 20, Given(0.02, 10.0), Given(0.0)])
    forgot = replace(jumped.progress, u_before=None, size_before=None)
    known, blind = (list(march.steps(begin, [Given(0.02)])) for begin in (jumped.progress, forgot))
    assert known[0].step.ratio == 0.0
    assert known[0].iterations < blind[0].iterations / 3
    assert known[0].force == pytest.approx(blind[0].force, rel=1e-6)


def test_the_papers_steps_and_blocks_do_without():
    assert not build(BRIEF.set(predictor="line")).march.whole({}).any()
    papers = StepControl(StepRules(largest=1.0, damage=0.1, paper=True), False)
    assert papers.after(StepState(0.02), 2, 0.09, 0.0, 0.05).size == 0.1
    assert papers.after(StepState(0.02), 2, 0.0, 0.0, 0.05, nascent=0.09).size == 0.1
    assert papers.after(StepState(0.02), 2, 0.0, 0.0, 0.05, nascent=0.11).size == 0.002


def test_a_refused_step_says_why():
    with pytest.raises(NoConvergence, match=r"damage .* 1\.10"):
        StepControl(StepRules(damage=0.5), False).check(StepState(0.05), 1.1, 0.0, 0.05)


def test_refused_steps_come_to_an_end_before_the_end_of_the_way():
    """After a crawl, whose steps are not shortened: the rest of the way may be shorter than they are."""
    now, room, tried = StepState(0.05, refused=50), 0.0036, []
    for _ in range(200):
        now = replace(now, size=min(now.size, room))
        tried.append(now.damping_factor)
        now = StepControl(StepRules()).shorter(
            now, EnergyError("the energy of the step closes only to 9%"), True
        )
        if now is None:
            break
    assert len(tried) < 100
    assert tried[-1] == 1e7


def test_what_happens_on_a_new_mesh_is_checked_too():
    control, now = StepControl(StepRules(damage=0.5, defect=0.05)), StepState(0.05, blade=SETTLES)
    control.check(now, 0.2, 0.01, 0.05)
    for growth, defect in ((1.1, 0.0), (0.0, 0.2)):
        with pytest.raises(NoConvergence) as refused:
            control.check(now, growth, defect, 0.05)
        # The blade rests already, so it is damping that is raised.
        tried = control.shorter(now, refused.value, True)
        assert tried.rests and tried.damping_factor > 1
    # With as much damping as there is, what is left open is left open: no run ends for that.
    control.check(StepState(0.05, 1e5, SETTLES), 0.0, 0.2, 0.05)
