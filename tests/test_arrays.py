"""The checks at the border, and the singular value decomposition that decides ranks."""

import numpy as np
import pytest
from hypothesis import given, settings

from ftforce.core.arrays import as_vector, read_only
from ftforce.core.reduced_jacobian import reduce
from ftforce.core.svd import Svd
from ftforce.errors import DimensionError, InputError
from helpers import RATIOS, assert_close, jacobians, with_singular_values

SHAPES = [(1, 1), (1, 5), (3, 1), (3, 2), (3, 3), (3, 7), (6, 5), (6, 7), (2, 12)]


def decomposed(A):
    """Decompose both ways that are in use: as a healthy and as a damaged arm's matrix."""
    m, n = A.shape
    padded = np.hstack([np.ones((m, 1)), A])  # its first joint is lost
    return Svd(A), reduce(padded, np.arange(n + 1) == 0).damaged


@pytest.fixture(params=SHAPES, ids=str)
def matrix(request):
    return np.random.default_rng(sum(request.param)).normal(size=request.param)


# ---- vectors ---------------------------------------------------------------------------------


@pytest.mark.parametrize("given", [[1, 2.5], (1, 2.5), np.array([1, 2.5], dtype=np.float32)])
def test_vectors_become_read_only_doubles(given):
    vector = as_vector(given, 2, "x")
    assert vector.dtype == np.float64
    assert vector.tolist() == [1.0, 2.5]
    assert not vector.flags.writeable
    if isinstance(given, np.ndarray):
        given[0] = 9.0
        assert vector.tolist() == [1.0, 2.5]


def test_any_size_is_taken_where_none_is_asked_for():
    assert as_vector([1, 2, 3], None, "x").shape == (3,)
    with pytest.raises(DimensionError, match="got an array of shape 1 x 2"):
        as_vector([[1, 2]], None, "x")


@pytest.mark.parametrize(
    ("given", "got"),
    [
        ([1, 2], "got 2 numbers"),
        ([1], "got 1 number"),
        ([], "got 0 numbers"),
        (7, "got a single number"),
        ([[1, 2, 3]], "got an array of shape 1 x 3"),
    ],
)
def test_wrong_sizes(given, got):
    with pytest.raises(DimensionError, match=f"force needs 3 numbers, {got}: fx, fy, fz") as caught:
        as_vector(given, 3, "force", "fx, fy, fz")
    assert (caught.value.name, caught.value.expected) == ("force", (3,))
    assert caught.value.got == np.shape(given)


@pytest.mark.parametrize("given", ["abc", ["a", "b"], [None, {}], [1, [2]], [1j, 0], object()])
def test_what_is_no_number(given):
    with pytest.raises(InputError, match="x needs numbers, got"):
        as_vector(given, 2, "x")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([0, np.nan, np.inf], "x contains nan at position 2"),
        ([0, 0, -np.inf], "x contains -inf at position 3"),
        ([1e200, 0, 0], "x contains numbers too large to compute with"),
    ],
)
def test_numbers_that_are_not_finite(given, message):
    with pytest.raises(InputError, match=message):
        as_vector(given, 3, "x")
    assert as_vector([1e150, -1e150], 2, "x")[0] == 1e150


# ---- decomposition ---------------------------------------------------------------------------


def test_ranks_and_projections(matrix):
    m, n = matrix.shape
    x, rank = np.arange(1.0, m + 1.0), min(m, n)
    for svd in decomposed(matrix):
        assert svd.rank(1e-9 * svd.s[0]) == rank
        assert_close(svd.project(x, rank), matrix @ np.linalg.pinv(matrix) @ x)
        assert svd.rank(0.5 * (svd.s[0] + ([*svd.s[:rank], 0.0])[1])) == 1
        assert_close(svd.project(x, 1), svd.U[:, 0] * (svd.U[:, 0] @ x))
        assert_close(svd.project(x, 0), 0.0)


@pytest.mark.parametrize(
    "arrange",
    [
        np.asfortranarray,
        lambda A: np.repeat(A, 2, axis=1)[:, ::2],
        lambda A: A[::-1][::-1],
        read_only,
    ],
    ids=["columns first", "strided", "reversed", "read-only"],
)
def test_the_layout_in_memory_plays_no_part(matrix, arrange):
    for plain, arranged in zip(decomposed(matrix), decomposed(arrange(matrix.copy())), strict=True):
        assert_close(arranged.s, plain.s)
        assert_close(
            arranged.project(np.ones(len(matrix)), 1), plain.project(np.ones(len(matrix)), 1)
        )


def test_a_decomposition_does_not_change_with_the_next_one(matrix):
    for svd, which in zip(decomposed(matrix), (0, 1), strict=True):
        before = svd.U.copy(), list(svd.s), svd.project(np.ones(len(matrix)), 1)
        decomposed(np.random.default_rng(9).normal(size=matrix.shape))[which]
        np.testing.assert_array_equal(svd.U, before[0])
        assert svd.s == before[1]
        np.testing.assert_array_equal(svd.project(np.ones(len(matrix)), 1), before[2])


@given(jacobians())
@settings(deadline=None, max_examples=100)
def test_any_matrix_against_numpy(J):
    s = np.linalg.svd(J, compute_uv=False)
    scale = s[0] or 1.0
    for svd in decomposed(J):
        assert len(svd.s) == len(J)
        assert_close(svd.s[: len(s)], s, scale=scale, tol=1e-13)
        assert_close(svd.s[len(s) :], 0.0, scale=scale, tol=1e-13)
        assert all(a >= b for a, b in zip(svd.s, svd.s[1:], strict=False))
        assert_close(svd.U.T @ svd.U, np.eye(len(J)), tol=1e-13)
        assert_close(svd.U @ np.diag(svd.s) ** 2 @ svd.U.T, J @ J.T, scale=scale**2, tol=1e-12)


@pytest.mark.parametrize("ratio", [r for r in RATIOS if r > 0.0])
def test_small_singular_values_are_accurate(ratio):
    A = with_singular_values(np.random.default_rng(3), 3, 7, np.array([1.0, 0.3, 0.3 * ratio]))
    for svd in decomposed(A):
        assert_close(svd.s, [1.0, 0.3, 0.3 * ratio], tol=1e-15)
