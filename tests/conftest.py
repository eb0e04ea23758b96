"""Robots that many tests ask about, and the report of the campaign."""

from itertools import chain

import pytest

import ftforce
from tally import Tally, table


@pytest.fixture(scope="session")
def dh5():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="session")
def panda():
    return ftforce.load_robot("panda")


@pytest.fixture
def tally(record_property):
    """Count the cases of a test; it fails at its end if one of them went wrong."""
    counts = Tally(record_property)
    yield counts
    counts.close()


def pytest_terminal_summary(terminalreporter):
    """Show what the campaign tried."""
    if lines := table(chain(*terminalreporter.stats.values())):
        terminalreporter.section("campaign")
        for line in lines:
            terminalreporter.line(line)


@pytest.fixture(scope="session")
def kernels():
    """Compile the kernels of most sweeps first: NumPy would give other last digits."""
    from ftforce.batch.warmup import KERNELS, warmup

    warmup(KERNELS[:1])
