"""Robots that many tests ask about."""

import pytest

import ftforce


@pytest.fixture(scope="session")
def dh5():
    return ftforce.load_robot("dh5")


@pytest.fixture(scope="session")
def panda():
    return ftforce.load_robot("panda")
