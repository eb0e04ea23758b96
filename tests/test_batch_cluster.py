"""Sweeps on Dask: the same bytes, whoever is lost on the way."""

import json
import socket
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

import ftforce
from ftforce.__version__ import __version__
from ftforce.batch import cluster
from ftforce.batch.cluster import run_batch
from ftforce.batch.store import folder, store
from ftforce.batch.sweep import sweep
from ftforce.errors import FtforceError, InputError, OutputError, TrajectoryError
from sweeps import LONG, content, differences

pytestmark = [
    pytest.mark.thorough,  # processes take seconds to start
    pytest.mark.usefixtures("kernels"),
]

ASKED = {"n": 40_000, "chunk": 4096, "force": [80.0, 50.0, 10.0]}


class Network:
    """A scheduler, and workers, each in a process of its own."""

    def __init__(self, folder):
        self.file, self.workers = folder / "scheduler.json", []
        options = ["--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(self.file)]
        self.scheduler = self._start("scheduler", *options)
        deadline = time.monotonic() + LONG
        while not self.file.exists() or not self.file.read_text().strip().endswith("}"):
            assert self.scheduler.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
        self.address = json.loads(self.file.read_text())["address"]

    @staticmethod
    def _start(*words):
        command = [sys.executable, "-m", "dask", *words, "--no-dashboard"]
        quiet = subprocess.DEVNULL
        return subprocess.Popen(command, stdout=quiet, stderr=quiet)

    def add_worker(self):
        """Start a worker of one thread that nobody restarts."""
        options = ["--host", "127.0.0.1", "--no-nanny", "--nthreads", "1"]
        self.workers.append(self._start("worker", self.address, *options))

    def close(self):
        """Kill them all."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def arm():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="module")
def undisturbed(arm, tmp_path_factory):
    path = tmp_path_factory.mktemp("undisturbed")
    for keep in ("summary", "all"):
        sweep(arm, **ASKED, keep=keep, output=path / keep)
    return {keep: content(path / keep) for keep in ("summary", "all")}


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    monkeypatch.setattr(cluster, "TIMEOUT", LONG)  # a slow machine shall not fail a test


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    made = Network(tmp_path_factory.mktemp("network"))
    made.add_worker()
    made.add_worker()
    yield made
    made.close()


def test_processes_of_this_machine_write_the_same_bytes(arm, tmp_path, undisturbed, capfd):
    sweep(arm, **ASKED, keep="all", workers=1, output=tmp_path / "s")
    assert capfd.readouterr() == ("", "")  # Dask's log stays off the terminal
    assert not differences(undisturbed["all"], content(tmp_path / "s"))


def test_a_scheduler_elsewhere_gives_the_same_bytes(arm, tmp_path, network, undisturbed):
    path, seen = tmp_path / "s", []
    asked = {**ASKED, "keep": "summary", "output": path, "scheduler": network.address}
    sweep(arm, **asked, progress=lambda done, total: seen.append(done))
    assert not differences(undisturbed["summary"], content(path))
    assert seen == sorted(seen)
    assert seen[-1] == ASKED["n"]


def test_given_postures_travel_in_parts(arm, network):
    q = np.random.default_rng(5).uniform(-2, 2, (20_000, 5))
    there = sweep(arm, q, chunk=4096, scheduler=network.address).summary.arrays()
    here = sweep(arm, q, chunk=4096).summary.arrays()
    for name, array in here.items():
        np.testing.assert_array_equal(there[name], array)


def test_an_error_on_a_worker_is_its_own_one_line(arm, tmp_path, network):
    file = tmp_path / "postures.npy"
    np.save(file, np.zeros((60_000, 5)))

    def remove(done, total):
        file.unlink(missing_ok=True)

    with pytest.raises(TrajectoryError, match=r"postures\.npy: cannot be read") as raised:
        sweep(arm, file, chunk=4096, scheduler=network.address, progress=remove)
    assert "\n" not in str(raised.value)
    assert raised.value.path == str(file)


def test_a_lost_worker_is_survived(arm, tmp_path, network, undisturbed):
    network.add_worker()

    def kill(done, total):
        if network.workers[2].poll() is None and done < total:
            network.workers[2].kill()

    sweep(arm, **ASKED, keep="all", scheduler=network.address, output=tmp_path / "s", progress=kill)
    network.workers[2].wait(LONG)
    assert not differences(undisturbed["all"], content(tmp_path / "s"))


def test_a_lost_scheduler_is_told_and_the_sweep_goes_on_elsewhere(
    arm, tmp_path, network, undisturbed, monkeypatch
):
    """It is the last test that needs the network."""
    monkeypatch.setattr(cluster, "TIMEOUT", 5.0)  # a client waits that long for its return
    asked = {**ASKED, "keep": "summary", "output": tmp_path / "s"}
    with pytest.raises(
        FtforceError, match=r"connection to the scheduler was lost.*resumes the sweep"
    ) as raised:
        sweep(
            arm,
            **asked,
            scheduler=network.address,
            progress=lambda done, total: network.scheduler.kill(),
        )
    assert "\n" not in str(raised.value)
    assert store.open_sweep(tmp_path / "s").summary.postures >= 4096
    sweep(arm, **asked)
    assert not differences(undisturbed["summary"], content(tmp_path / "s"))


# ---- what is told beforehand -----------------------------------------------------------------


def test_something_at_the_address_that_never_answers(arm, monkeypatch):
    monkeypatch.setattr(cluster, "TIMEOUT", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(InputError, match="no scheduler responds"):
            sweep(arm, n=5000, scheduler=address)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x", "tcp://", ""])
def test_nobody_at_the_address(arm, monkeypatch, address):
    monkeypatch.setattr(cluster, "TIMEOUT", 1.0)
    with pytest.raises(InputError, match=f"responds at '{address}'.*expected an address such as"):
        sweep(arm, n=5000, scheduler=address)


def _workers(**found):
    """Return a client of workers with these versions of ftforce."""
    about = {name: {"packages": {"ftforce": one}} for name, one in found.items()}
    versions = {"client": {"packages": {"ftforce": "1.0"}}, "workers": about}
    return SimpleNamespace(
        wait_for_workers=lambda n, timeout: None, get_versions=lambda packages: versions
    )


def test_workers_need_this_ftforce():
    cluster._check_workers(_workers(a="1.0"), "tcp://s")
    with pytest.raises(FtforceError, match=r"must run ftforce 1\.0; b has 0\.0\.9, c has none$"):
        cluster._check_workers(_workers(a="1.0", b="0.0.9", c=None), "tcp://s")


def test_a_scheduler_without_workers():
    def wait_for_workers(n, timeout):
        raise TimeoutError

    empty = SimpleNamespace(wait_for_workers=wait_for_workers)
    with pytest.raises(FtforceError, match=r"no workers; start some, e\.g\. dask worker tcp://s"):
        cluster._check_workers(empty, "tcp://s")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"workers": 0}, "must be a positive integer"),
        ({"workers": True}, "must be a positive integer"),
        ({"workers": 2, "scheduler": "tcp://x"}, "not both"),
        ({"workers": 2, "threads": 2}, "either threads of this process or workers"),
        ({"workers": 1, "keep": "all"}, "requires an output folder"),
    ],
)
def test_options_that_make_no_sense(arm, options, words):
    with pytest.raises(InputError, match=words):
        sweep(arm, n=5000, **options)


# ---- on the worker ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def opened(arm, tmp_path_factory):
    """A sweep that has just been made."""
    caught = []

    def runner(job, made, turns):
        caught.append(made)
        raise KeyboardInterrupt
        yield

    import ftforce.batch.sweep as module

    path = tmp_path_factory.mktemp("opened") / "s"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_runner", lambda *_: runner)
        with pytest.raises(KeyboardInterrupt):
            sweep(arm, **ASKED, keep="all", output=path)
    return caught[0]


def test_a_turn_writes_its_chunks(opened):
    token = folder.lock_of(opened.path)["token"]
    turn = run_batch(opened.request.job, str(opened.path), token, __version__, [2, 5])
    assert turn.chunks == [2, 5]
    assert turn.summary.postures == 2 * 4096
    written = (opened.path / "margin").glob("[0-9]*")
    assert sorted(file.name for file in written) == ["2.0", "5.0"]


def test_a_worker_that_sees_another_folder_says_so(opened, tmp_path):
    for path, token in ((opened.path, "another"), (tmp_path / "none", "any")):
        with pytest.raises(OutputError, match="not visible to all workers") as raised:
            run_batch(opened.request.job, str(path), token, __version__, [0])
        assert raised.value.path == str(path)


def test_a_worker_of_another_version_says_so(opened):
    with pytest.raises(FtforceError, match=r"all workers must run ftforce 0\.0\.9"):
        run_batch(opened.request.job, None, "", "0.0.9", [0])


def _failing(problem):
    def result():
        raise problem

    return SimpleNamespace(result=result)


def test_workers_that_die_of_the_same_chunks():
    from distributed import KilledWorker

    with pytest.raises(FtforceError, match="4 workers were lost while processing the same chunks"):
        cluster._result(_failing(KilledWorker("key", None, 3)))


def test_what_a_worker_lacks_is_told_in_one_line():
    lacks = ModuleNotFoundError("No module named 'numba'\nand more")
    with pytest.raises(FtforceError, match=r"a worker failed.*No module named 'numba'") as raised:
        cluster._result(_failing(lacks))
    assert "\n" not in str(raised.value)
