"""What a discovery says at last: what was found, what remains, and when it cannot tell."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from cutbench.discovery import heldout, outcome, report, rounds, search


def a_round(*, p_residual: float, accepted: str | None = None, tried=("gent",), failed=()):
    point = SimpleNamespace(campaign=SimpleNamespace(train=[SimpleNamespace(repetitions=(1, 2, 3))]))
    scores = SimpleNamespace(p_residual=p_residual, scores=tried, expected=None)
    return SimpleNamespace(point=point, scores=scores, accepted=accepted, failed=failed)


@pytest.mark.parametrize(
    ("rounds", "remains", "verdict"),
    [
        ([a_round(p_residual=0.5)], 1.0, "none"),
        ([a_round(p_residual=0.0)], 1.0, "unexplained"),
        ([a_round(p_residual=0.0, failed=("gent",))], 1.0, "undecided"),
        ([a_round(p_residual=0.0, tried=())], 1.0, "undecided"),
        # What was found is named, however much of what was wrong it leaves.
        ([a_round(p_residual=0.0, accepted="gent"), a_round(p_residual=0.5)], 0.0, "mechanism"),
        ([a_round(p_residual=0.0, accepted="gent"), a_round(p_residual=0.0)], 0.1, "mechanism"),
        ([a_round(p_residual=0.0, accepted="gent"), a_round(p_residual=0.0)], 0.7, "mechanism"),
        # Unless the rest may be that of a candidate that could not be tried.
        ([a_round(p_residual=0.0, accepted="gent"), a_round(p_residual=0.0, failed=("mullins",))], 0.7,
         "undecided"),
        ([a_round(p_residual=0.0, accepted="gent"), a_round(p_residual=0.0, failed=("mullins",))], 0.1,
         "mechanism"),
    ],
)  # fmt: skip
def test_a_verdict_names_what_helped(monkeypatch, rounds, remains, verdict):
    monkeypatch.setattr(search, "Yardstick", lambda *given: SimpleNamespace(left=lambda point: remains))
    assert search._verdict(rounds) == verdict


@pytest.mark.parametrize(
    ("chance", "better", "how", "meshed", "named"),
    [
        (1e-3, 20.0, heldout.TESTS, False, True),
        # What the fitted tests leave in doubt those that were not fitted may tell, if they surely do.
        (0.05, 50.0, heldout.TESTS, False, True),
        (0.05, 30.0, heldout.TESTS, False, False),
        (0.2, 50.0, heldout.TESTS, False, False),
        (0.05, 50.0, "one repetition after the other", False, False),
        (0.05, 50.0, heldout.TESTS, True, False),
    ],
)
def test_what_convinces(chance, better, how, meshed, named):
    held = heldout.Heldout(how, better, 10.0, 0.3, 0.1, 2.0, 1.4, 0.5, "N", 0.4)
    point = SimpleNamespace(meshed=meshed)
    assert outcome.Tried(None, point, held, 10.0, chance, 0.8).convincing == named


@pytest.mark.parametrize(
    ("rounds", "meshed", "remains", "enough"),
    [
        (0, True, 1.0, rounds.PROMISING),
        (1, True, 0.05, outcome.CHANCE),
        (1, True, 0.005, 0.0),
        (1, False, 0.005, outcome.CHANCE),
    ],
)
def test_of_cuts_nothing_more_is_asked_where_little_remains(monkeypatch, rounds, meshed, remains, enough):
    monkeypatch.setattr(search, "Yardstick", lambda *given: SimpleNamespace(left=lambda point: remains))
    made = search._Search(None, SimpleNamespace(meshed=meshed), None, True, 0, None)
    made.rounds = [a_round(p_residual=0.0, accepted="maxwell")] * rounds
    assert made._enough == enough


class Where(SimpleNamespace):
    """A part of a curve."""

    experiment = SimpleNamespace(id="slow", x_name="stretch")
    regime, range = "", "1.2 to 1.4"


@pytest.mark.parametrize(("rest", "p", "partly"), [(0.7, 0.0, True), (0.1, 0.0, False), (0.7, 0.5, False)])
def test_a_cause_that_leaves_much_is_called_a_part(rest, p, partly):
    final = SimpleNamespace(misfit={"slow": 0.12, "fast": 0.01})
    rounds = [a_round(p_residual=0.0, accepted="gent"), a_round(p_residual=p)]
    d = SimpleNamespace(
        verdict="mechanism", found=("gent",), causes=(None,), rest=rest, final=final, rounds=rounds,
        telling=SimpleNamespace(accepted="gent", group=("gent",)),
        wrong=[Where()],
    )  # fmt: skip
    text = report.verdict_sentence(d)
    assert text.startswith("A part of what") is partly
    assert ("remains, in 'slow' 12 %" in text) is (p == 0.0)
    assert "gent" in text
