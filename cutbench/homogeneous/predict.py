"""What a model says of a test without a mesh, and by how much each parameter changes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.toml import one_of
from cutbench.case.model import Model
from cutbench.data.experiment import HOMOGENEOUS, SLOTS, Experiment
from cutbench.data.repetition import Averaged
from cutbench.homogeneous.history import LoadingHistory
from cutbench.homogeneous.interface import separation, sliding
from cutbench.homogeneous.rig import Machine
from cutbench.homogeneous.stretching import nominal_stress
from cutbench.mechanisms.base import MODULUS, STEP


def predict(
    experiment: Experiment, model: Model, p: SimpleNamespace, at: Averaged | None = None
) -> np.ndarray:
    """Predict the readings of a test without a mesh. Gives (n,). Raises BadInput or ComputationFailed."""
    return _read(experiment, model, p, at or experiment.on_grid(), 1)[:, 0]


def respond(
    kind: str, history: LoadingHistory, model: Model, p: SimpleNamespace, *, direction: str = "opening"
) -> np.ndarray:
    """Compute the stress or traction along a loading history.

    It is complex if ``p`` has complex values: with p.G = G + 1e-30j the imaginary part over 1e-30 is the
    exact derivative by G. What the testing machine does is no part of it. Gives (n,). Raises BadInput.
    """
    return _respond(kind, history, model, p, direction, 1)[:, 0]


def slopes(
    experiment: Experiment, model: Model, p: SimpleNamespace, names: Sequence[str], at: Averaged | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Predict the readings of a test, and their exact derivatives by parameters.

    All derivatives come from one pass along the history. Gives ``readings`` (n,), ``derivatives`` (n, k).
    Raises BadInput.
    """
    at = at or experiment.on_grid()
    for name in names:
        if not hasattr(p, name):
            raise BadInput("parameter", name, one_of(name, vars(p)))
    if not names:
        return predict(experiment, model, p, at), np.zeros((at.x.size, 0))
    out = _complex_stepped(experiment, model, p, [({}, name) for name in names], at)
    return out[:, 0].real.copy(), out.imag / STEP


def scan(
    experiment: Experiment,
    model: Model,
    p: SimpleNamespace,
    names: Sequence[str],
    sets: Sequence[Mapping[str, float]],
    at: Averaged | None = None,
) -> np.ndarray:
    """Compute exact derivatives of the readings of a test at several sets of values.

    All of them come from one pass along the history where the model has a memory. Gives (s, n, k).
    """
    at = at or experiment.on_grid()
    out = _complex_stepped(experiment, model, p, [(values, name) for values in sets for name in names], at)
    return (out.imag / STEP).reshape(at.x.size, len(sets), len(names)).transpose(1, 0, 2)


def _complex_stepped(
    experiment: Experiment,
    model: Model,
    p: SimpleNamespace,
    pairs: Sequence[tuple[Mapping[str, float], str]],
    at: Averaged,
) -> np.ndarray:
    """Readings (n, len(pairs)) with the values of each pair in ``p`` and a complex step in what it names."""
    stepped = []
    for values, name in pairs:
        moved = {**vars(p), **values}
        stepped.append(model.namespace({**moved, name: moved[name] + 1j * STEP}))
    batched = any(law.start(1, p) or law.directed for law in model.laws("bulk"))
    if experiment.kind == "sliding" or (experiment.kind in HOMOGENEOUS and not batched):
        # Without memory all readings are solved at once, and soon: the parameters come one by one.
        return np.stack([_read(experiment, model, one, at, 1)[:, 0] for one in stepped], axis=1)
    batch = SimpleNamespace(**vars(p))
    moving = dict.fromkeys(key for values, name in pairs for key in (*values, name))
    for key in (*moving, *([MODULUS] if model.derives_modulus else [])):
        setattr(batch, key, np.array([getattr(one, key) for one in stepped], dtype=complex))
    return _read(experiment, model, batch, at, len(pairs))


def _read(experiment: Experiment, model: Model, p: SimpleNamespace, at: Averaged, count: int) -> np.ndarray:
    """(n, count), with what the testing machine does."""
    history = LoadingHistory.of(experiment, at)
    p = SimpleNamespace(**{**vars(p), **model.turned(experiment.angle)})
    # What is not known of the machine in a test is left out there.
    if not (model.laws("rig") and experiment.mounted and "rig" in SLOTS[experiment.kind]):
        return _respond(experiment.kind, history, model, p, experiment.direction, count)
    machine = Machine(experiment, model, p, at)
    own = machine.specimen(history)
    return machine.reading(_respond(experiment.kind, own, model, p, experiment.direction, count))


def _respond(kind, history, model, p, direction, count) -> np.ndarray:
    """(n, count)."""
    if kind in HOMOGENEOUS:
        return nominal_stress(kind, history, model, p, count=count)
    if kind == "sliding":
        return sliding(history, model, p)[:, None]
    if kind == "separation":
        return separation(history, model, p, direction, count=count)
    raise BadInput("kind", kind, "a test without a mesh; a cut is computed by run_case(campaign.case(…))")
