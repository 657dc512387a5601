"""What a fit is made of: parameters within bounds, weights, and what data can tell."""

from __future__ import annotations

import re

import numpy as np
import pytest

from cutbench.base.units import Parameter
from cutbench.calibration.identifiability import identifiability, information_inverse
from cutbench.calibration.mesh_error import (
    begun_later,
    correction,
    guessed_error,
    local_linear_smooth,
    measured_error,
    sizes_of_error,
)
from cutbench.calibration.parameters import FreeParameter
from cutbench.data.covariance import USUAL_FACTOR, Block, Covariance, Factors, matern, with_discrepancy
from cutbench.data.repetition import Averaged
from cutbench.mechanisms import registry

G, MU = (registry()[m].parameters[0] for m in ("neo_hookean", "coulomb"))


def looked_for(name: str, start: float = 1.0, low: float = 0.0, high: float = np.inf) -> FreeParameter:
    return FreeParameter(Parameter(name, "1", name, "a number", low=0, open_low=True), start, low, high)


def test_a_product_cannot_be_separated():
    x = np.linspace(0.1, 1, 30)[:, None]
    a, b, c = looked_for("a"), looked_for("b"), looked_for("c")
    # y = a b x + c x², by the logarithms of a, b, c; noise 0.01.
    J = np.hstack([x, x, x**2]) / 0.01
    said = identifiability(J, [a, b, c])
    (sentence,) = said.sentences
    assert {"a", "b"} <= set(re.findall(r"\w+", sentence)) and "c" not in re.findall(r"\w+", sentence)
    assert said.joint[2] < 0.1 < 1e3 < said.joint[0]
    assert said.alone[0] < 0.01
    assert abs(said.correlation[0, 1]) > 0.999


def test_a_parameter_that_nothing_depends_on_is_named():
    J = np.column_stack([np.ones(10), np.zeros(10)])
    said = identifiability(J, [looked_for("a"), looked_for("b")])
    (sentence,) = said.sentences
    assert "b" in re.findall(r"\w+", sentence) and "a" not in re.findall(r"\w+", sentence)
    assert said.joint[1] == np.inf


def test_fewer_readings_than_parameters_are_not_enough():
    rng = np.random.default_rng(0)
    J = 100 * rng.standard_normal((2, 3))
    said = identifiability(J, [looked_for(n) for n in "abc"])
    assert said.singular_values.size == 3 and said.singular_values[-1] == 0
    assert said.sentences
    assert np.sqrt(np.diag(information_inverse(J))).max() > 1e3


def test_a_sum_that_is_known_and_a_difference_that_is_not():
    J = np.array([[100.0, 100.0], [0.5, -0.5]])
    said = identifiability(J, [looked_for("a"), looked_for("b")])
    np.testing.assert_allclose(said.singular_values, [np.sqrt(2) * 100, np.sqrt(0.5)])
    np.testing.assert_allclose(information_inverse(J), np.linalg.inv(J.T @ J), rtol=1e-9)


def test_values_stay_off_open_bounds_and_on_closed_ones():
    u = FreeParameter(G, 0.04, 0.0, np.inf)
    assert u.logarithmic and u.value(np.log(2)) == pytest.approx(0.08)
    assert u.value(-1e6) > 0 and np.isfinite(u.value(1e6))
    nu = registry()["volumetric"].parameters[0]
    u = FreeParameter(nu, 0.49, 0.0, 0.5)
    assert u.value(50.0) < 0.5
    u = FreeParameter(MU, 0.1, 0.0, np.inf)
    assert not u.logarithmic and u.value(-50.0) == 0.0
    assert u.q(u.value(0.3)) == pytest.approx(0.3)


def grid_of(curves: np.ndarray, reading: float) -> Averaged:
    m = curves.shape[1]
    sd = np.full(m, reading)
    x = np.linspace(0, 1, m)
    return Averaged(x, curves.mean(axis=0), np.zeros(m), sd, curves)


def test_the_factor_of_specimens_is_recovered_and_noise_is_not_taken_for_it():
    rng = np.random.default_rng(4)
    y = np.linspace(0.2, 1, 40)
    grids = [
        grid_of(y * (1 + 0.03 * rng.standard_normal((3, 1))) + 0.01 * rng.standard_normal((3, 40)), 0.01)
        for _ in range(200)
    ]
    found = Factors.of(grids)
    assert found.dof == 400
    assert np.sqrt(found.variance) == pytest.approx(0.03, rel=0.1)
    alone = Factors.of([grid_of(y[None], 0.01)])
    assert (alone.variance, alone.dof) == (0.0, 0)


def test_whitened_residuals_have_unit_variance():
    # Many campaigns of three specimens: what is left between the mean and the truth, whitened, is white.
    rng = np.random.default_rng(5)
    y = 1 + np.linspace(0, 1, 25) ** 2
    pooled, white = Factors(0.03**2, 100), []
    for _ in range(300):
        noise = 0.01 * rng.standard_normal((3, 25))
        curves = y * (1 + 0.03 * rng.standard_normal((3, 1))) + noise
        grid = grid_of(curves, 0.01)
        white.append(Block.of(grid, pooled, y).white(grid.mean - y))
    assert np.var(white) == pytest.approx(1.0, abs=0.15)


def test_the_covariance_is_that_of_its_parts():
    y = np.linspace(0.5, 1, 10)
    computed = 0.1**2 * np.eye(10)
    alike = np.stack([y, y, y])
    block = Block.of(grid_of(alike, 0.2), Factors(0.27, 3), y, computed)
    expected = 0.09 * np.outer(y, y) + (0.2**2 / 3 + 0.1**2) * np.eye(10)
    np.testing.assert_allclose(block.total, expected, rtol=0.01, atol=1e-4)
    L = np.linalg.cholesky(block.total)
    np.testing.assert_allclose(block.white(y), np.linalg.solve(L, y), rtol=1e-9)


def test_one_specimen_leaves_what_is_usual_between_specimens():
    """Its noise alone would make a factor of a per cent look like a discovery."""
    y = np.linspace(0.2, 1, 40)
    covariance = Covariance.of({"a": grid_of(y[None], 1e-3)}, {"a": "uniaxial"}, {"a": y})
    assert covariance.factors["uniaxial"].variance == pytest.approx(USUAL_FACTOR**2)
    deviation = covariance.tests["a"].deviation / y
    assert np.all((deviation > 0.02) & (deviation < 0.06))
    bend = 0.03 * y * np.sin(np.pi * np.linspace(0, 1, 40))
    assert 0.3 < np.linalg.norm(covariance.white({"a": bend})) < 3


@pytest.mark.parametrize("specimens", [1, 3, 8])
def test_drawn_data_scatter_as_their_own_covariance_says(specimens):
    rng = np.random.default_rng(7)
    y = np.linspace(0.3, 1, 30)
    curves = y * (1 + 0.03 * rng.standard_normal((specimens, 1))) + 0.01 * rng.standard_normal(
        (specimens, 30)
    )
    covariance = Covariance.of({"a": grid_of(curves, 0.01)}, {"a": "cut"}, {"a": y})
    drawn = [covariance.draw(rng) for _ in range(200)]
    means = np.array([residual["a"].mean() for residual, _ in drawn])
    stated = np.sqrt(np.mean([made.tests["a"].total.mean() for _, made in drawn]))
    assert means.std() == pytest.approx(stated, rel=0.35)
    assert abs(means.mean()) < 0.3 * stated


def test_a_curve_that_misses_the_shape_gains_nothing_by_shrinking():
    """What the model misses has one size along the curve, whatever the model's."""
    x = np.linspace(0, 1, 40)
    measured, model = 1 - (1 - x) ** 4, x  # far from one another
    rng = np.random.default_rng(8)
    for specimens in (1, 5):
        curves = measured * (1 + 0.03 * rng.standard_normal((specimens, 1)))
        grid, factor = grid_of(curves + 1e-3 * rng.standard_normal(curves.shape), 1e-3), 1.0
        for _ in range(5):
            w = Covariance.of({"a": grid}, {"a": "cut"}, {"a": factor * model})
            w = with_discrepancy(w, {"a": factor * model - grid.mean}, {"a": model[:, None]})
            J, r = w.white({"a": model}), w.white({"a": grid.mean})
            factor = (J @ r) / (J @ J)
        assert 0.8 < factor / (model @ grid.mean / (model @ model)) < 1.25


def test_the_computations_error_is_taken_from_a_finer_mesh():
    x = np.linspace(0, 2, 40)
    grid = Averaged(x, x, 0 * x, 0 * x, x[None])
    limit = x + 0.1 * np.sin(3 * x)
    coarse, fine = limit - 0.04 * x**2, limit - 0.01 * x**2  # an error of second order, halved elements
    moved = coarse + correction(grid, coarse, fine, 0.0)
    # Between first order (2 e) and none (e).
    assert np.abs(moved - limit).max() < 0.5 * np.abs(coarse - limit).max()
    sd = np.sqrt(np.diag(measured_error(grid, coarse, fine, 0.0)))
    assert np.all(np.abs(moved - limit)[5:] < 2 * sd[5:])
    # Jags are not carried on: they count as noise.
    rng = np.random.default_rng(6)
    jagged = fine + 0.02 * rng.standard_normal(40)
    rough = np.sqrt(np.diag(measured_error(grid, coarse, jagged, 0.0)))
    assert np.median(rough[:10]) > 4 * np.median(sd[:10])
    assert 0.01 < np.median(rough[:10]) < 0.06


def test_a_window_leaves_lines_as_they_are():
    x = np.linspace(0, 3, 40)
    np.testing.assert_allclose(local_linear_smooth(x, 2 - 3 * x), 2 - 3 * x, atol=1e-9)
    assert matern(np.zeros(1), 1.0)[0] == 1.0


@pytest.mark.parametrize("by", [-0.01, -0.004, 0.004, 0.01])
def test_a_cut_that_begins_a_hundredth_elsewhere_is_no_other_curve(by):
    """However steep the drop, and wherever it lies between two values of the grid."""
    x = np.linspace(0.1, 5.0, 40)
    for begins in np.linspace(2.9, 3.1, 9):

        def curve(x, begins=begins):
            return np.where(x < begins, x, 0.6 * begins + 0.1 * (x - begins))

        y, grid = curve(x), Averaged(x, curve(x), 0 * x, 0 * x, curve(x)[None])
        later = -by * begins
        off = np.where(x < begins + later, x, curve(x - later)) - y
        assert off @ np.linalg.solve(guessed_error(grid, y, begins, (1.0, 0.2)), off) < x.size


@pytest.mark.parametrize("later", [-0.02, 0.0, 0.02])
def test_where_a_cut_begins_elsewhere_the_way_before_is_as_it_was(later):
    x = np.linspace(0.1, 5.0, 400)

    def curve(begins):
        return np.where(x < begins, 2 * x, 3.6 - 0.1 * (x - begins))

    def moved(begins):
        return begun_later(Averaged(x, x, 0 * x, 0 * x, x[None]), curve(begins), begins, later)

    np.testing.assert_allclose(moved(3.0), curve(3.0 * (1 + later)), atol=1e-2)
    np.testing.assert_array_equal(moved(9.0), curve(9.0))


@pytest.mark.parametrize("values", [1, 3, 8])
@pytest.mark.parametrize("by", [-0.03, 0.03])
def test_few_readings_behind_where_a_cut_begins_err_as_many_do(values, by):
    """A finer mesh that has less force behind has less, and the error is of the size of that."""
    x = np.linspace(0.1, 5.0, 40)
    begins = x[-values] - 0.01
    coarse = np.where(x < begins, x, 0.6 * begins)
    fine, grid = np.where(x < begins, coarse, (1 + by) * coarse), Averaged(x, x, 0 * x, 0 * x, x[None])
    added = correction(grid, coarse, fine, begins) / coarse
    np.testing.assert_allclose(added, np.where(x < begins, 0.0, 1.5 * by), atol=1e-9)
    _, behind = sizes_of_error(grid, coarse, fine, begins)
    assert 0.2 < behind < 0.6  # 0.7 of 3 %, over 5 %


def test_a_drop_that_is_far_off_costs_by_the_way_and_not_by_its_depth():
    """Student's t: five standard deviations cost no more than they may, however steep the drop."""
    x = np.linspace(0.1, 5.0, 40)

    def curve(begins, depth):
        return np.where(x < begins, x, (1 - depth) * begins)

    for depth in (0.2, 0.4, 0.8):
        y = curve(3.0, depth)
        grid, off = Averaged(x, y, 0 * x, 0 * x, y[None]), curve(3.0 * 1.06, depth) - y
        error = guessed_error(grid, y, 3.0)
        assert 2 < off @ np.linalg.solve(error, off) < 60
        # Before it begins the forces are known.
        sd = np.sqrt(np.diag(error)) / y
        assert sd[x < 2.5].max() < 0.02 < sd[x > 3.3].min()


@pytest.mark.parametrize("measures", [1, 4])
def test_measures_have_an_error_each_and_none_of_where_a_cut_begins(measures):
    y, along = np.linspace(1.0, 2.0, measures), np.arange(1.0, measures + 1)
    grid = Averaged(along, y, 0 * y, 0 * y, y[None], independent=True)
    error = guessed_error(grid, y, 2.5)
    np.testing.assert_allclose(error, np.diag(np.diag(error)))
    np.testing.assert_allclose(np.sqrt(np.diag(error)) / y, 0.02)
