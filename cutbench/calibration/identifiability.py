"""What data can tell about parameters: from the sensitivities, before anything is fitted, and in words.

With J (m, k) the derivatives of all readings by the scaled parameters q, whitened by the covariance of the
readings, the information is JᵀJ. A singular value s of J is the reciprocal of a standard deviation: along
its right singular vector q is known to 1/s. A parameter with an open lower bound at 0 is scaled as its
logarithm, so that 0.1 is ten per cent of it; another in units of ``FreeParameter.scale``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutbench.calibration.parameters import FreeParameter


@dataclass(frozen=True)
class Limits:
    """From where on data tell something of a parameter.

    Attributes
    ----------
    told : float
        Standard deviation along a direction of q beyond which the data do not tell: half of the value.
    component : float
        Components of a direction that count, relative to its largest.
    fitted : float
        A parameter that a fit may choose is left at its start where the data know it worse than this.
    """

    told: float = 0.5
    component: float = 0.25
    fitted: float = 3.0


LIMITS = Limits()


@dataclass(frozen=True)
class Identifiability:
    """Identifiability says which of k parameters the data can tell, alone and together.

    It comes from the singular values of the whitened derivatives J by the scaled parameters q.

    Attributes
    ----------
    labels : tuple of str
        The parameters.
    singular_values : ndarray, shape (k,)
        Of J, descending.
    alone : ndarray, shape (k,)
        Standard deviation of each q if all others were known.
    joint : ndarray, shape (k,)
        The same with all of them unknown; inf where the data do not tell.
    correlation : ndarray, shape (k, k)
        Correlations of the parameters.
    sentences : tuple of str
        What a person should know: what no reading depends on, and what is known only in combination.
    """

    labels: tuple[str, ...]
    singular_values: np.ndarray
    alone: np.ndarray
    joint: np.ndarray
    correlation: np.ndarray
    sentences: tuple[str, ...]


def identifiability(J: np.ndarray, parameters: Sequence[FreeParameter]) -> Identifiability:
    """Find out which parameters the data can tell, from whitened derivatives. With ``J`` (m, k)."""
    labels, size = tuple(u.label for u in parameters), np.linalg.norm(J, axis=0)
    # What is a matter of rounding is no sensitivity at all.
    blind = size <= 1e-9 * max(size.max(initial=0.0), 1e-300)
    _, s, Vt = _singular_values(J)
    alone = np.where(blind, np.inf, 1 / np.where(blind, 1, size))
    covariance = information_inverse(J)
    joint = np.sqrt(np.where(blind, np.inf, np.diag(covariance)))
    sentences = [f"No reading depends on {labels[i]}." for i in np.flatnonzero(blind)]
    for value, v in zip(s, Vt, strict=True):
        sd = 1 / value if value > 0 else math.inf
        if sd > LIMITS.told and not blind[np.argmax(np.abs(v))]:
            sentences.append(_sentence(v, sd, parameters))
    return Identifiability(labels, s, alone, joint, correlations(covariance), tuple(sentences))


def information_inverse(J: np.ndarray) -> np.ndarray:
    """(JᵀJ)⁻¹, by scaled columns; directions without information get a huge variance, not an error."""
    size = np.linalg.norm(J, axis=0)
    size = np.where(size > 0, size, 1.0)
    _, s, Vt = _singular_values(J / size)
    floor = max(s.max(initial=0.0), 1e-100) * 1e-10
    return (Vt.T / np.maximum(s, floor) ** 2 @ Vt) / np.outer(size, size)


def _singular_values(J: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Singular values (k,) of J (m, k) and its vectors, also those that too few readings leave at 0."""
    missing = max(J.shape[1] - J.shape[0], 0)
    return np.linalg.svd(np.pad(J, ((0, missing), (0, 0))), full_matrices=False)


def correlations(covariance: np.ndarray) -> np.ndarray:
    d = np.sqrt(np.diag(covariance))
    return covariance / np.outer(d, d)


def _sentence(v: np.ndarray, sd: float, parameters: Sequence[FreeParameter]) -> str:
    """What it means that the data know q only to ``sd`` along ``v``."""
    largest = int(np.argmax(np.abs(v)))
    parts = [i for i in np.argsort(-np.abs(v)) if abs(v[i]) >= LIMITS.component * abs(v[largest])]
    how = "at all" if sd > 10 else f"to better than {_amount(parameters[largest], sd)}"
    if len(parts) == 1:
        return f"These data do not determine {parameters[largest].label} {how}."
    # A change that all the noise hides: one standard deviation, or a tenth of the largest where more.
    shown = v / abs(v[largest]) * min(sd * abs(v[largest]), 0.1) * np.sign(v[largest])
    moves = [
        f"{'raising' if shown[i] > 0 else 'lowering'} {parameters[i].label} by"
        f" {_amount(parameters[i], abs(shown[i]))}"
        for i in parts
    ]
    *names, last = (parameters[i].label for i in parts)
    apart = f"{names[0]} from {last}" if len(names) == 1 else f"{', '.join(names)} and {last}"
    change = f"{moves[0]} while {' and '.join(moves[1:])}"
    return f"These data cannot separate {apart}: {change} changes the readings by less than their noise."


def _amount(u: FreeParameter, dq: float) -> str:
    return f"{100 * dq:.0f} %" if u.logarithmic else u.quantity.show(dq * u.scale)


def identifiable(
    J: np.ndarray, parameters: Sequence[FreeParameter], asked: Sequence[str]
) -> tuple[list[int], dict[str, str]]:
    """Numbers of the parameters that the data can tell, and why the others stay where they are.

    The worst leaves first: what it was confounded with may then be known well. ``asked`` names stay.
    """
    kept, fixed = list(range(len(parameters))), {}
    while len(kept) > 1:
        found = identifiability(J[:, kept], [parameters[i] for i in kept])
        may_go = [i for i in range(len(kept)) if parameters[kept[i]].name not in asked]
        worst = max(may_go, key=lambda i: found.joint[i], default=None)
        if worst is None or found.joint[worst] <= LIMITS.fitted:
            break
        u, alone = parameters[kept.pop(worst)], found.alone[worst]
        fixed[u.label] = (
            "no reading depends on it" if not np.isfinite(alone)
            else "the data do not determine it" if alone > LIMITS.fitted
            else "the data do not tell it from other parameters"
        )  # fmt: skip
    return kept, fixed
