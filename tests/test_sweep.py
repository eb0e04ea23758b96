"""Sweeps in Python: the same numbers however they are cut, done and kept."""

import sys

import numpy as np
import pytest

import ftforce
from ftforce.batch import job as jobs
from ftforce.batch import runner
from ftforce.batch.runner import BatchSizer, threads_of
from ftforce.batch.summary.summary import Summary
from ftforce.batch.sweep import _chunk_of, sweep
from ftforce.errors import InputError, UnknownNameError
from helpers import joint, urdf_of

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.usefixtures("kernels"),
]


@pytest.fixture(scope="module")
def arm():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="module")
def reference(arm):
    return sweep(arm, n=20_000, force=[80, 50, 10], threads=1)


def _assert_same(first, second):
    for name, array in first.summary.arrays().items():
        np.testing.assert_array_equal(array, second.summary.arrays()[name], name)


@pytest.mark.parametrize(
    "options", [{"threads": 2}, {"chunk": 4096, "threads": 3}, {"keep": "all"}]
)
def test_how_it_is_done_changes_no_bit(arm, reference, options):
    _assert_same(reference, sweep(arm, n=20_000, force=[80, 50, 10], **options))


@pytest.mark.parametrize("answers", [2**8, 2**12])
def test_small_pieces_change_no_bit(arm, reference, monkeypatch, answers):
    monkeypatch.setattr(jobs, "_BLOCK_RESULTS", answers)
    _assert_same(reference, sweep(arm, n=20_000, force=[80, 50, 10]))


def test_it_is_what_analyze_says_of_each_posture(arm):
    result = sweep(arm, n=5000, force=[80, 50, 10], keep="all")
    for i in (0, 17, 4095, 4096, 4999):
        q = result.dataset.q.values[i]
        for s, one in enumerate(result.sets):
            found = ftforce.analyze(arm, q, locked=[one.joints[0] + 1], force=[80, 50, 10])
            np.testing.assert_allclose(result.dataset.margin[i, s], found.margin, rtol=1e-9)
            assert ("tolerated", "borderline", "not tolerated")[
                int(result.dataset.verdict[i, s])
            ] == str(found.verdict.value).replace("_", " ")


def test_progress_rises_to_the_number_of_postures(arm):
    seen = []
    sweep(arm, n=30_000, chunk=4096, progress=lambda done, total: seen.append((done, total)))
    assert [done for done, _ in seen] == sorted({done for done, _ in seen})
    assert seen[-1] == (30_000, 30_000)


def test_turns_deal_out_every_chunk_once():
    turns = BatchSizer(iter(range(1000)), 1000)
    dealt, sizes = [], []
    while chunks := turns.next(4, 1.0):
        dealt += chunks
        sizes.append(len(chunks))
        turns.took(len(chunks), 0.01 * len(chunks))
    assert dealt == list(range(1000))
    assert sizes[0] == 1  # nothing is known yet
    assert max(sizes) == 100  # a second
    assert sizes[-1] == 1  # all end at about the same time


def test_turns_of_no_time_are_single_chunks():
    turns = BatchSizer(iter(range(9)), 9)
    turns.took(1, 1e-4)
    assert turns.next(1, 0.0) == [0]


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({}, InputError, "give postures, or how many"),
        ({"n": 10, "q": np.zeros((3, 5))}, InputError, "not both"),
        ({"n": 0}, InputError, "from 1"),
        ({"n": 10, "keep": "some"}, UnknownNameError, "all"),
        ({"n": 10, "threads": 0}, InputError, "must be a positive integer"),
        ({"n": 10, "chunk": 10}, InputError, "from 4096"),
        ({"n": 10, "force": [0, 0, 0]}, InputError, "must not be zero"),
    ],
)
def test_what_makes_no_sense_is_told(arm, options, error, words):
    with pytest.raises(error, match=words):
        sweep(arm, **options)


def test_threads_are_those_of_the_process():
    assert threads_of(None) >= 1
    assert threads_of(3) == 3


def test_chunks_are_smaller_for_many_sets_and_fit_a_codec():
    stored = {"is_stored": True}
    assert [_chunk_of(None, sets, 70_000, **stored) for sets in (7, 63)] == [65_536, 16_384]
    assert _chunk_of(None, 7, 5000, **stored) == _chunk_of(8192, 7, 5000, **stored) == 5000
    with pytest.raises(InputError, match=r"a chunk with 5 fault sets can hold at most .* postures"):
        _chunk_of(100_000_000, 5, 10**9, **stored)
    sizes = [_chunk_of(None, 7, count, is_stored=False) for count in (5000, 400_000, 10**8)]
    assert sizes == [4096, 8192, 65_536]


def test_a_wrist_whose_tip_never_moves(tmp_path):
    path = tmp_path / "wrist.urdf"
    links = ["base", "l1", "l2", "l3", "l4"]
    axes = [(0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 0, 1)]
    joints = [
        joint(f"j{i}", "revolute", links[i], links[i + 1], axis=axis) for i, axis in enumerate(axes)
    ]
    path.write_text(urdf_of(*links, joints=joints))
    wrist = ftforce.load_robot(path)
    found = sweep(wrist, n=1000, task="moment")
    assert int(found.summary.cell_postures.max()) == 1000
    assert int(found.summary.outside) == 0


@pytest.mark.parametrize(
    ("direction", "unit"), [([0, 0, 0, 0, 0, 1], "N·m"), ([0, 0, 1, 0, 0, 1], "N")]
)
def test_a_capability_has_the_unit_of_its_direction(arm, direction, unit):
    found = sweep(arm, n=100, task="wrench", length=0.3, direction=direction)
    assert found.setting.capability_unit == unit
    assert found.setting.size_unit == "N"
    assert found.dataset.summary_min_capability.attrs["units"] == unit.replace("·", " ")


def test_without_a_force_nobody_knows_what_falls():
    panda = ftforce.load_robot("panda")
    asked = {"n": 500, "mode": "free", "task": "fx,fz"}
    without = sweep(panda, **asked, direction=[0, 1])
    assert np.isnan([one.falls for one in without.ranked]).all()
    assert max(one.falls for one in sweep(panda, **asked, force=[0, 1]).ranked) > 0.0


def test_a_small_sweep_needs_neither_threads_nor_zarr(dh5, monkeypatch):
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (9000, 5))
    with monkeypatch.context() as patch:
        for name in ("zarr", "xarray", "filelock"):  # found, but of no use
            patch.setitem(sys.modules, name, sys)
        patch.setattr(runner, "ThreadPoolExecutor", None)
        patch.setattr(Summary, "merge", None)
        found = sweep(dh5, q, force=[80, 50, 10], keep="worst", threads=2)
    assert found.done == len(q)
    np.testing.assert_array_equal(found.dataset["q"], q)  # made when it is asked for


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_threads_share_the_chunks(dh5, threads):
    """Too many postures for the calling thread alone, in more chunks than there are threads."""
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (40_000, 5))
    found = sweep(dh5, q, force=[80, 50, 10], threads=threads, keep="worst")
    alone = sweep(dh5, q, force=[80, 50, 10], chunk=40_000, keep="worst")
    _assert_same(found, alone)
    np.testing.assert_array_equal(found.dataset["worst_margin"], alone.dataset["worst_margin"])
