"""Quadrature on a small piece, and local matrices put together."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest
from form_checks import HEIGHT, LENGTH, SIZE, space_of, spaces

from cutbench.forms.assembly import Pattern
from cutbench.forms.base import add_states
from cutbench.forms.space import face_quadrature


@spaces
def test_quadrature_measures_the_piece(dim, order):
    space = space_of(dim, order)
    deep = LENGTH if dim == 3 else 1.0
    v = space.volume(3)
    assert v.w.sum() == pytest.approx(SIZE * HEIGHT * deep, rel=1e-13)
    assert (v.w * v.X[0] ** 2 * v.X[1]).sum() == pytest.approx(HEIGHT**2 / 2 * SIZE**3 / 3 * deep, rel=1e-12)
    across, up = np.eye(dim)[:2]
    for name, area, outward in (("cut", HEIGHT * deep, -across), ("top", SIZE * deep, up)):
        f = space.faces(name, 4)
        assert f.w.sum() == pytest.approx(area, rel=1e-13)
        np.testing.assert_allclose(f.normal, np.broadcast_to(outward[:, None], f.normal.shape), atol=1e-13)
        np.testing.assert_allclose(f.N.sum(axis=1), 1, atol=1e-13)
        np.testing.assert_allclose(f.dN.sum(axis=2), 0, atol=1e-11)
        at_points = np.einsum("qaf,daf->dqf", f.N, space.X[:, f.nodes])
        np.testing.assert_allclose(at_points, f.X, atol=1e-13)
        slope = np.einsum("sqaf,daf->sdqf", f.dN, space.X[:, f.nodes])
        np.testing.assert_allclose(slope, np.broadcast_to(f.tangents[:, :, None], slope.shape), atol=1e-11)


def tables(rng, ndof: int) -> dict[str, np.ndarray]:
    return {
        name: np.stack([rng.permutation(ndof)[:nd] for _ in range(n)], axis=1)
        for name, nd, n in (("bulk", 6, 25), ("faces", 3, 9))
    }


@pytest.mark.parametrize("fixed", [[], [0, 3, 17, 29]], ids=["all free", "some fixed"])
def test_assembly_equals_the_dense_sum(fixed):
    rng, ndof = np.random.default_rng(8), 30
    dofs = tables(rng, ndof)
    free = np.setdiff1d(np.arange(ndof), fixed)
    dense = np.zeros((ndof, ndof))
    vector = np.zeros(ndof, complex)
    full = Pattern(ndof, np.array(fixed, int), dofs, symmetric=False)
    upper = Pattern(ndof, np.array(fixed, int), dofs, symmetric=True)
    data, half, summed = np.zeros(full.indices.size), np.zeros(upper.indices.size), 0
    for name, table in dofs.items():
        nd, n = table.shape
        local = rng.normal(size=(nd, nd, n))
        local = local + local.transpose(1, 0, 2)
        force = rng.normal(size=(nd, n)) + 1j * rng.normal(size=(nd, n))
        for e in range(n):
            dense[np.ix_(table[:, e], table[:, e])] += local[:, :, e]
            vector[table[:, e]] += force[:, e]
        full.add(data, name, local)
        upper.add(half, name, local)
        summed = summed + full.vector(name, force)
    expected = dense[np.ix_(free, free)]
    np.testing.assert_allclose(summed, vector, atol=1e-13)
    np.testing.assert_allclose(full.csr(data).toarray(), expected, atol=1e-13)
    np.testing.assert_allclose(upper.csr(half).toarray(), np.triu(expected), atol=1e-13)
    assert upper.indices.size < full.indices.size
    np.testing.assert_array_equal(full.free, free)
    np.testing.assert_allclose(data[full.diagonal], np.diag(expected), atol=1e-13)


def test_unsymmetric_local_matrices_keep_rows_and_columns_apart():
    rng, ndof = np.random.default_rng(9), 12
    table = np.stack([rng.permutation(ndof)[:4] for _ in range(5)], axis=1)
    pattern = Pattern(ndof, np.array([2]), {"only": table}, symmetric=False)
    local, dense = rng.normal(size=(4, 4, 5)), np.zeros((ndof, ndof))
    for e in range(5):
        dense[np.ix_(table[:, e], table[:, e])] += local[:, :, e]
    data = np.zeros(pattern.indices.size)
    pattern.add(data, "only", local)
    free = pattern.free
    np.testing.assert_allclose(pattern.csr(data).toarray(), dense[np.ix_(free, free)], atol=1e-13)


@pytest.mark.parametrize("part", [1.0, 1j], ids=["real", "complex"])
def test_forces_in_balance_are_weighed_by_block_and_without_what_is_apart(part):
    rng, ndof, apart = np.random.default_rng(5), 30, np.array([0, 3, 17, 29])
    dofs = tables(rng, ndof)
    pattern = Pattern(ndof, apart, dofs, symmetric=False)
    forces = {name: rng.normal(size=t.shape) + part * rng.normal(size=t.shape) for name, t in dofs.items()}
    whole = {name: pattern.vector(name, force) for name, force in forces.items()}
    total, scale = pattern.balance(forces, apart)
    np.testing.assert_allclose(total, sum(whole.values()), atol=1e-13)
    lengths = (np.linalg.norm(vector[pattern.free].real) for vector in whole.values())
    assert scale == pytest.approx(sum(lengths), rel=1e-13)


@pytest.mark.parametrize("symmetric", [False, True])
def test_a_pattern_that_grows_is_one_made_anew(symmetric):
    rng, ndof, fixed = np.random.default_rng(3), 30, np.array([0, 3, 17, 29])
    dofs, pairs = tables(rng, ndof), np.stack([rng.permutation(ndof)[:4] for _ in range(6)], axis=1)
    vectors = dofs | {"pairs": np.arange(ndof)[:, None]}
    locals_ = {name: rng.normal(size=(t.shape[0], *t.shape)) for name, t in (dofs | {"pairs": pairs}).items()}
    old = Pattern(ndof, fixed, vectors, symmetric, idle={"pairs"})
    few = old.grown("pairs", pairs[:, :2])[0]
    grown, moved = old.grown("pairs", pairs)
    anew = Pattern(ndof, fixed, vectors, symmetric, couples={"pairs": pairs})
    for pattern in (grown, few.grown("pairs", pairs)[0]):
        np.testing.assert_array_equal(pattern.indices, anew.indices)
        np.testing.assert_array_equal(pattern.indptr, anew.indptr)
        np.testing.assert_array_equal(pattern.diagonal, anew.diagonal)
        np.testing.assert_allclose(pattern.matrices(locals_), anew.matrices(locals_), atol=1e-13)
    before = {name: locals_[name] for name in dofs}
    np.testing.assert_allclose(grown.matrices(before)[moved], old.matrices(before), atol=1e-13)


def test_a_diagonal_entry_is_kept_where_nothing_is_assembled():
    pattern = Pattern(4, np.array([], int), {"only": np.array([[0], [1]])}, symmetric=True)
    assert pattern.csr(np.ones(pattern.indices.size)).diagonal().tolist() == [1, 1, 1, 1]


def test_two_laws_with_one_name_for_their_state_are_refused():
    assert add_states({"a": 1}, {"b": 2}) == {"a": 1, "b": 2}
    with pytest.raises(ValueError, match="'a'"):
        add_states({"a": 1}, {"a": 2})


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("degree", [1, 2, 4, 5, 6, 9])
def test_rules_of_faces_are_exact_and_have_points_on_corners(dim, degree):
    """∫ xⁱ yʲ over the unit triangle is i! j!/(i + j + 2)!, ∫ xⁱ over the line 1/(i + 1)."""
    x, w = face_quadrature(dim, degree)
    assert np.all(w > 0) and w.size <= (12 if degree <= 5 else 127)
    corners = np.eye(dim)[:, 1:]
    assert np.abs(x.T[:, None] - corners[None]).max(axis=2).min(axis=0) == pytest.approx(0, abs=1e-14)
    for i in range(degree + 1):
        for j in range(degree + 1 - i if dim == 3 else 1):
            exact = factorial(i) * factorial(j) / factorial(i + j + dim - 1)
            assert (w * x[0] ** i * x[-1] ** j).sum() == pytest.approx(exact, rel=1e-11)
