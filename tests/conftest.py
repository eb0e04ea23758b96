"""Robots that many tests ask about."""

import pytest

import ftforce


@pytest.fixture(scope="session")
def dh5():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="session")
def panda():
    return ftforce.load_robot("panda")


@pytest.fixture(scope="session")
def kernels():
    """Compile the kernels of most sweeps first: NumPy would give other last digits."""
    from ftforce.batch.warmup import KERNELS, warmup

    warmup(KERNELS[:1])
