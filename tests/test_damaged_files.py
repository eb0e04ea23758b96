"""Lost, cut, altered and hostile files: the right numbers or one line, never other numbers."""

from __future__ import annotations

import json
import os
import random
import shutil

import numpy as np
import pytest
import zarr
from numcodecs import Blosc, Pickle

import ftforce
from ftforce.batch.store import manifest, store
from ftforce.batch.sweep import sweep
from ftforce.errors import FtforceError, SweepError
from sweeps import content, differences

pytestmark = [
    pytest.mark.thorough,  # hundreds of sweeps are opened
    pytest.mark.usefixtures("kernels"),
]

ASKED = {
    "n": 5000,
    "chunk": 4096,
    "force": [80.0, 50.0, 10.0],
    "cell": 1.0,
    "threads": 1,
    "keep": "all",
}
HARMS = {
    "lost": lambda data, chance: None,
    "truncated": lambda data, chance: data[: chance.randrange(len(data))],
    "one bit": lambda data, chance: flipped(data, chance, 1),
    "20 bits": lambda data, chance: flipped(data, chance, 20),
}


def flipped(data, chance, count):
    altered = bytearray(data)
    for bit in chance.sample(range(8 * len(data)), min(count, 8 * len(data))):
        altered[bit // 8] ^= 1 << bit % 8
    return bytes(altered)


def harmed(path, harm, chance):
    """Harm a file, and return its content before."""
    before = path.read_bytes()
    after = HARMS[harm](before, chance)
    path.unlink()
    if after is not None:
        path.write_bytes(after)
    return before


def numbers(path, suspect=""):
    """Return everything that a stored sweep says, as bytes; a suspect array is read first."""
    found = ftforce.open_sweep(path)
    if suspect in found.dataset.variables:
        found.dataset[suspect].load()
    arrays = {name: array.values for name, array in found.dataset.variables.items()}
    arrays = {k: array.astype("U") if array.dtype == "O" else array for k, array in arrays.items()}
    arrays |= {f"own {name}": array for name, array in found.summary.arrays().items()}
    about = {"setting": repr(found.setting).encode(), "sets": repr(found.sets).encode()}
    return about | {name: array.tobytes() for name, array in arrays.items()}


def answer(path, suspect):
    """Return the numbers of a stored sweep, or why there are none."""
    try:
        return numbers(path, suspect), ""
    except FtforceError as problem:
        return None, str(problem)


@pytest.fixture(scope="module")
def arm():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="module")
def whole(arm, tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "s"
    sweep(arm, **ASKED, output=path)
    return path


ASKED_ELSE = {
    "without a force": {"force": None, "limits": None},
    "free joints": {"mode": "free", "friction": 0.1, "payload": 1.0},
    "capability": {"direction": [0.0, 0.0, 1.0], "limits": "urdf", "task": "fx,fy,fz", "faults": 2},
    "worst set": {"keep": "worst", "task": "wrench", "force": [1.0, 2, 3, 4, 5, 6], "length": 0.3},
    "summary": {"keep": "summary"},
}


@pytest.fixture(scope="module", params=["whole", "half", *ASKED_ELSE])
def kind_of_store(request, arm, tmp_path_factory):
    """Return the name of a kind of store, and one of it."""
    kind = request.param
    if kind not in ASKED_ELSE:
        return kind, request.getfixturevalue(kind)
    path = tmp_path_factory.mktemp("kinds") / "s"
    sweep(arm, **{**ASKED, **ASKED_ELSE[kind]}, output=path)
    return kind, path


@pytest.fixture(scope="module")
def half(arm, tmp_path_factory):
    """A sweep of which one of two chunks is done."""
    path = tmp_path_factory.mktemp("half") / "s"

    def progress(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(arm, **ASKED, output=path, progress=progress)
    return path


@pytest.fixture
def copied(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "s")


def test_a_store_gives_the_right_numbers_or_one_line(kind_of_store, tally):
    kind, path = kind_of_store
    right, chance = numbers(path), random.Random(kind)
    cases = [(name, harm) for name in sorted(content(path)) for harm in HARMS]
    chance.shuffle(cases)
    refusals = 0
    for number in tally.numbers("files of a sweep", len(cases)):
        name, harm = cases[number]
        before = harmed(path / name, harm, random.Random(f"{kind} {number}"))
        found, said = answer(path, name.partition("/")[0])
        (path / name).write_bytes(before)
        tally.tried(refused=found is None)
        refusals += found is None
        if "\n" in said or len(said) > 400:
            tally.fails("unclear messages", (number, name, harm), said)
        # Without its progress file, nothing is known to be done.
        if found not in (None, right) and (name, harm) != (".progress.npz", "lost"):
            tally.fails("silent differences", (number, name, harm), "other numbers")
    assert refusals
    assert numbers(path) == right


SOME = (".manifest", "verdict/0.0", "margin/1.0", "summary_verdicts/0.0", ".zmetadata", "rank/0")


@pytest.mark.parametrize("kind", ["whole", "half"])
def test_the_same_sweep_computes_again_what_was_lost(arm, kind, request, tmp_path, whole):
    chance = random.Random(kind)
    harms = list(HARMS)
    for i, name in enumerate(SOME):
        path = shutil.copytree(request.getfixturevalue(kind), tmp_path / str(i))
        if not (path / name).exists():
            continue
        harmed(path / name, harms[i % len(harms)], chance)
        if name == ".manifest" and kind == "whole":
            with pytest.raises(FtforceError, match=r"lacks its file \.manifest|damaged"):
                sweep(arm, **ASKED, output=path)
            continue
        result = sweep(arm, **ASKED, output=path)
        assert int(result.summary.postures) == ASKED["n"]
        assert not differences(content(whole), content(path)), name


def test_only_the_damaged_chunk_is_computed_again(arm, copied, monkeypatch):
    (copied / "verdict" / "1.0").unlink()
    written, real = [], store.write_samples
    monkeypatch.setattr(
        store, "write_samples", lambda *given: (written.append(given[1]), real(*given))[1]
    )
    sweep(arm, **ASKED, output=copied)
    assert written == [1]


def test_a_copy_that_was_cut_off_says_so(copied):
    for name in ("tip", "verdict"):
        shutil.rmtree(copied / name)
    with pytest.raises(SweepError, match=r"is incomplete: 8 of .* files are missing"):
        ftforce.open_sweep(copied)


def test_a_plain_reader_sees_lost_verdicts_as_unknown(copied):
    (copied / "verdict" / "1.0").unlink()
    (copied / "rank_lost" / "1.0").unlink()
    group = zarr.open_group(copied, mode="r", zarr_format=2)
    assert (group["verdict"][4096:] == 0).all()
    assert group["verdict"].attrs["flag_values"] == [1, 2, 3]
    assert (group["rank_lost"][4096:] < 0).all()


def test_any_array_may_be_all_fill_value(tmp_path):
    text = """<robot name="planar"><link name="base"/><link name="upper"/><link name="lower"/>
        <link name="tool"/>
        <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
        <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
        <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
        <origin xyz="1 0 0"/><axis xyz="0 0 1"/>
        <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
        <joint name="end" type="fixed"><parent link="lower"/><child link="tool"/>
        <origin xyz="0.5 0 0"/></joint></robot>"""
    (tmp_path / "arm.urdf").write_text(text)
    planar = ftforce.load_robot(tmp_path / "arm.urdf")
    path = tmp_path / "s"
    for _ in range(2):  # stored, and opened
        found = sweep(planar, n=500, output=path, task="fx,fy,fz", keep="all")
        assert found.done == 500
    assert np.isnan(ftforce.open_sweep(path).dataset["rho"]).all()


# ---- what a stranger may put into a store ----------------------------------------------------


def resealed(path, name, data):
    """Write a file of a store, and a manifest that agrees with it, as its author could."""
    (path / name).write_bytes(data)
    found = manifest.read_manifest(path, SweepError)
    files = {**found.files, name: manifest.digest_of(data)}
    (path / ".manifest").write_bytes(found._replace(files=files).to_bytes())


def with_metadata(path, array, **changes):
    about = json.loads((path / ".zmetadata").read_text())
    about["metadata"][f"{array}/.zarray"].update(changes)
    name = f"{array}/.zarray"
    resealed(path, ".zmetadata", json.dumps(about).encode())
    resealed(path, name, json.dumps(about["metadata"][name]).encode())


class Trap:
    """Something that leaves a mark when it is unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (self.mark,)


def test_nothing_in_a_store_is_executed(copied, tmp_path):
    mark = tmp_path / "executed"
    trap = Pickle().encode(np.array([Trap(str(mark))], dtype=object))
    resealed(copied, "summary_verdicts/0.0", bytes(Blosc().encode(trap)))
    with_metadata(copied, "summary_verdicts", dtype="|O", filters=[{"id": "pickle", "protocol": 5}])
    with pytest.raises(SweepError, match=r"summary_verdicts.*filters"):
        numbers(copied)
    assert not mark.exists()


@pytest.mark.parametrize(
    "changes",
    [
        {"compressor": {"id": "pickle", "protocol": 5}},
        {"compressor": None},
        {"filters": [{"id": "delta", "dtype": "<i8"}]},
        {"dtype": "|O"},
        {"dtype": ">i8"},
        {"shape": [10**12, 5]},
        {"chunks": [10**9, 5]},
        {"chunks": [0, 5]},
        {"order": "F"},
        {"dimension_separator": "/"},
        {"zarr_format": 3},
    ],
)
def test_metadata_that_ftforce_does_not_write_is_refused(copied, changes):
    with_metadata(copied, "verdict", **changes)
    with pytest.raises(SweepError, match="is damaged or not from ftforce: array 'verdict'"):
        numbers(copied)


def test_a_chunk_that_declares_more_than_its_array_is_refused(copied):
    bomb = Blosc("lz4", clevel=5, shuffle=1).encode(np.zeros(10_000_000))
    resealed(copied, "summary_verdicts/0.0", bytes(bomb))
    with pytest.raises(SweepError, match=r"size of summary_verdicts/0\.0"):
        numbers(copied)


def _link(path):
    path.rename(path.with_name("moved"))
    path.symlink_to(path.with_name("moved"))


def _fifo(path):
    path.unlink()
    os.mkfifo(path)


def _device(path):
    path.unlink()
    path.symlink_to("/dev/zero")


@pytest.mark.parametrize("name", ["verdict/0.0", ".zmetadata", ".manifest", "verdict"])
@pytest.mark.parametrize("make", [_link, _fifo, _device])
def test_links_pipes_and_devices_in_a_store_are_refused(arm, whole, copied, make, name):
    if name == "verdict" and make is not _link:
        shutil.rmtree(copied / name)
        (copied / name).touch()
    make(copied / name)
    with pytest.raises(SweepError, match=r"not (a )?regular"):
        ftforce.open_sweep(copied)
    if name != ".manifest":
        sweep(arm, **ASKED, output=copied)
        assert not differences(content(whole), content(copied)) or make is _link
