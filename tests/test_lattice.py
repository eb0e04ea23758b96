"""Dynamic programming on lattices of postures, against every path there is."""

from itertools import product

import numpy as np
import pytest

from ftforce.planning.lattice import Layer, best_path, breaks_of


def lattice(seed, sizes=(3, 4, 2, 4, 3), n=2):
    """Return random layers, the largest steps between them, and which joints wrap."""
    rng = np.random.default_rng(seed)
    layers = [Layer(rng.uniform(-3, 3, (s, n)), np.round(rng.uniform(0, 1, s), 1)) for s in sizes]
    return layers, rng.uniform(2.0, 5.0, (len(sizes) - 1, n)), rng.random(n) < 0.5


def distance(a, b, wraps):
    """Return how far each joint moves."""
    turn = b - a
    return np.abs(np.where(wraps, np.arctan2(np.sin(turn), np.cos(turn)), turn))


def all_paths(layers, steps, wraps):
    """Yield every path with its largest ratio of motion to step, smallest value and mean."""
    for chosen in product(*(range(len(layer.q)) for layer in layers)):
        q = [layer.q[i] for layer, i in zip(layers, chosen, strict=True)]
        values = [layer.value[i] for layer, i in zip(layers, chosen, strict=True)]
        ratio = max(
            (distance(a, b, wraps) / step).max()
            for a, b, step in zip(q, q[1:], steps, strict=False)
        )
        yield ratio, min(values), np.mean(values)


@pytest.mark.parametrize("seed", range(30))
def test_best_path_is_the_best_of_all(seed):
    layers, steps, wraps = lattice(seed)
    found = best_path(layers, steps, wraps)
    every = list(all_paths(layers, steps, wraps))
    within = [(worst, mean) for ratio, worst, mean in every if ratio <= 1.0]
    if not within:
        assert found is None
        return
    worst, mean = max(within)
    assert found.worst == worst
    assert found.mean == pytest.approx(mean, rel=1e-12)
    q = [layer.q[i] for layer, i in zip(layers, found.chosen, strict=True)]
    for a, b, step in zip(q, q[1:], steps, strict=False):
        assert (distance(a, b, wraps) <= step).all()


@pytest.mark.parametrize("seed", range(30))
def test_least_slow_down_is_the_least_of_all(seed):
    layers, steps, wraps = lattice(seed)
    steps = 0.3 * steps
    least = min(ratio for ratio, _, _ in all_paths(layers, steps, wraps))
    found = breaks_of(layers, steps, wraps)
    assert found.slow_down == pytest.approx(least, rel=1e-12)
    assert (best_path(layers, steps, wraps) is None) == bool(found.waypoints) == (least > 1.0)
    assert best_path(layers, steps * found.slow_down, wraps) is not None
    assert best_path(layers, steps * found.slow_down * (1.0 - 1e-9), wraps) is None


def test_postures_without_value_are_not_used():
    q = np.zeros((2, 1))
    layers = [Layer(q, np.array([np.nan, 0.5])), Layer(q, np.array([0.7, -np.inf]))]
    found = best_path(layers, np.ones((1, 1)), np.array([False]))
    assert found.chosen.tolist() == [1, 0]
    layers[0] = Layer(q, np.full(2, np.nan))
    assert best_path(layers, np.ones((1, 1)), np.array([False])) is None
    assert breaks_of(layers, np.ones((1, 1)), np.array([False])).slow_down == np.inf


def test_a_minimum_is_not_made_up_for_by_the_mean():
    stays, moves = np.array([[0.0], [1.0]]), np.array([[0.0], [8.0]])
    layers = [Layer(stays, np.array([0.5, 0.4])), Layer(moves, np.array([0.5, 0.9]))]
    found = best_path(layers, np.array([[7.0]]), np.array([False]))
    assert (found.worst, found.chosen.tolist()) == (0.5, [0, 0])
