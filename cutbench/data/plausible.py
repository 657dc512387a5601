"""Whether a measurement can be of the material that it is said to be of: a unit read wrong shows here.

Each test compares one number of the data with one of the material, far apart enough that no real
difference between specimens comes near, and near enough that a factor of a thousand cannot pass.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cutbench.case.case import Case
from cutbench.data.experiment import HOMOGENEOUS, Experiment
from cutbench.data.repetition import Repetition
from cutbench.mechanisms.base import Blade, Points

#: Nominal stress of neo-Hooke at constant volume over G, by the stretch.
NEO_HOOKE: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "uniaxial": lambda x: x - x**-2,
    "equibiaxial": lambda x: x - x**-5,
    "pure_shear": lambda x: x - x**-3,
}
#: A modulus this many times that of the material, or as little of it, is not believed.
MAX_MODULUS_RATIO = 100.0
#: Force on a blade over G · length · travel: real cuts lie between 0.05 and 5.
CUT_FORCE_RANGE = (0.005, 50.0)
#: A shear or cohesive strength against the material's.
MAX_STRENGTH_RATIO = 300.0


def refuse_implausible(experiment: Experiment, case: Case) -> None:
    """Raise BadInput if the readings cannot be of the material of ``case``."""
    modulus_MPa = case.model.shear_modulus(case.p)
    if experiment.kind == "cut":
        travel_fits(experiment)
    for r in experiment.repetitions if experiment.curve else ():
        if experiment.kind in HOMOGENEOUS:
            _stretch(r)
            _modulus(experiment, r, modulus_MPa)
        elif experiment.kind == "cut":
            _cut(experiment, r, modulus_MPa)
        elif experiment.kind == "sliding":
            _sliding(experiment, r, case)
        else:
            _separation(r, case)


def apparent_modulus(experiment: Experiment, r: Repetition) -> float:
    """Shear modulus in MPa of neo-Hooke through the readings of a homogeneous test below a stretch of 1.5."""
    small = np.abs(np.log(r.x)) < np.log(1.5)
    if small.sum() < 3:
        small = np.argsort(np.abs(r.x - 1))[:5]
    unit = NEO_HOOKE[experiment.kind](r.x[small])
    return float(unit @ r.y[small] / (unit @ unit)) if unit @ unit > 0 else float("nan")


def _ratio_text(ratio: float) -> str:
    return f"{ratio:.2g} times" if ratio >= 1 else f"1/{1 / ratio:.2g} of"


def _stretch(r: Repetition) -> None:
    i = int(np.argmax(r.x))
    if r.x[i] > 30:
        expected = "stretches below 30: is a displacement in another unit, or a strain in percent?"
        raise r.wrong("stretch", f"{r.x[i]:.4g}", expected, i)


def _modulus(experiment: Experiment, r: Repetition, G: float) -> None:
    found = apparent_modulus(experiment, r)
    if found > 0 and not 1 / MAX_MODULUS_RATIO < found / G < MAX_MODULUS_RATIO:
        expected = (
            f"about that of the material, {1e3 * G:.3g} kPa; {_ratio_text(found / G)} it looks like a"
            " wrong unit of force, stress, length or area, or a wrong material"
        )
        raise r.wrong("stress", f"a shear modulus of {1e3 * found:.3g} kPa", expected, _largest(r))


def _largest(r: Repetition) -> int:
    return int(np.argmax(np.abs(r.y)))


def travel_fits(experiment: Experiment) -> None:
    """Raise BadInput if a cut goes far through its specimen, or hardly into it."""
    height = experiment.specimen.get("height", np.inf)
    for r in experiment.repetitions:
        i = int(np.argmax(r.x))
        if r.x[i] > 1.5 * height:
            expected = f"at most 1.5 times the specimen's height of {height:g} mm; is it in another unit?"
            raise r.wrong("displacement", f"{r.x[i]:.4g} mm", expected, i)
        if r.x[i] < 2e-3 * height and np.isfinite(height):
            expected = f"a travel into the specimen of {height:g} mm; is it in another unit?"
            raise r.wrong("displacement", f"{r.x[i]:.4g} mm at the most", expected, i)


def _cut(experiment: Experiment, r: Repetition, G: float) -> None:
    far = int(np.argmax(r.x)) + 1
    x = np.append(0.0, r.x[:far])
    work = float(np.trapezoid(np.append(0.0, r.y[:far]), x))
    if "length" not in experiment.specimen:  # made without a file: nothing to hold it against
        return
    natural = G * experiment.specimen["length"] * x[-1] ** 2 / 2
    ratio = work / natural
    if not CUT_FORCE_RANGE[0] < ratio < CUT_FORCE_RANGE[1]:
        expected = (
            f"a force of the order of G · length · travel, {natural / x[-1]:.3g} N (the material has G ="
            f" {1e3 * G:.3g} kPa); {_ratio_text(ratio)} it looks like a wrong unit or a wrong material"
        )
        raise r.wrong("force", f"{work / x[-1]:.3g} N on average", expected, _largest(r))


def _sliding(experiment: Experiment, r: Repetition, case: Case) -> None:
    pressure = experiment.pressure_MPa if r.pressure_MPa is None else float(np.median(r.pressure_MPa))
    at = Points(touched=np.ones(1), slid=np.zeros(1), slip_rate=np.zeros(1))
    laws = [law for law in case.model.all if isinstance(law, Blade)]
    strength = sum(float(law.strength(np.array([pressure]), case.p, {}, at)[0]) for law in laws)
    found = float(np.median(np.abs(r.y)))
    if strength > 0 and found > 0 and not 1 / MAX_STRENGTH_RATIO < found / strength < MAX_STRENGTH_RATIO:
        expected = (
            f"about the strength of the material's interface, {1e3 * strength:.3g} kPa;"
            f" {_ratio_text(found / strength)} it looks like a wrong unit of force or area"
        )
        raise r.wrong("traction", f"{1e3 * found:.3g} kPa (median)", expected, _largest(r))


def _separation(r: Repetition, case: Case) -> None:
    parts = [law.estimate(case.p, 0.0, 0.0) for law in case.model.laws("cut")]
    strength, opening = sum(e.strength for e in parts), sum(e.opening for e in parts)
    if not strength:
        return
    i = int(np.argmax(r.y))
    for key, found, wanted, unit in (
        ("traction", 1e3 * r.y[i], 1e3 * strength, "kPa"),
        ("opening", r.x[i], opening, "mm"),
    ):
        if found > 0 and not 1 / MAX_STRENGTH_RATIO < found / wanted < MAX_STRENGTH_RATIO:
            expected = (
                f"about that of the material, {wanted:.3g} {unit}; {_ratio_text(found / wanted)} it looks"
                " like"
            )
            raise r.wrong(key, f"{found:.3g} {unit} at the peak", expected + " a wrong unit", i)
