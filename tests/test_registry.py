"""Known robots: names, entries and where the files are."""

import re
import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from ftforce import load_robot
from ftforce.errors import FtforceError, UnknownNameError
from ftforce.robot import known_robots as registry
from ftforce.robot.known_robots import find_robot, known_robots, robots_folder
from urdfs import arm, write

WANTED = {
    "panda", "ur5", "ur10", "ur3", "xarm7", "kinova", "z1", "talos_left_arm", "baxter_left",
    "baxter_right", "tiago", "pr2_left", "pr2_right", "so100", "so101", "dh5", "canadarm2",
    "ur3e", "ur5e", "ur10e", "ur16e", "iiwa14", "fr3", "gen3", "xarm6", "sawyer",
}  # fmt: skip
KEYS = {"about", "urdf", "srdf", "bundled", "tip", "base", "posture", "postures", "corrections",
        "notes", "same_motors"}  # fmt: skip


@pytest.fixture
def fresh():
    """Forget what is cached, before and after."""

    def forget():
        known_robots.cache_clear()
        registry._example_robots.cache_clear()

    forget()
    yield
    forget()


def test_the_promised_names_are_there():
    assert set(known_robots()) >= WANTED


def test_entries_are_complete_and_hold_nothing_else():
    with (robots_folder() / "robots.toml").open("rb") as file:
        entries = tomllib.load(file)
    assert list(entries) == list(known_robots())
    for name, entry in entries.items():
        assert set(entry) <= KEYS, name
        known = find_robot(name)
        assert known.name == name
        assert known.about == entry["about"]
        assert known.urdf.is_file()
        assert known.srdf is None or known.srdf.is_file()
        assert (known.srdf is None) == ("srdf" not in entry)
        assert known.posture, name
        for correction in known.corrections:
            assert correction.effort >= 0
            assert len(correction.reason) > 20, "a correction states its reason"


@pytest.mark.parametrize("name", ["pandda", "PANDA", "panda_"])
def test_an_unknown_name_lists_the_known_ones(name):
    with pytest.raises(UnknownNameError, match=r"did you mean 'panda'\?") as caught:
        find_robot(name)
    assert str(caught.value).startswith(f"unknown robot or file {name!r}; available: ")
    assert set(caught.value.available) == set(known_robots())


@pytest.mark.parametrize(
    "name",
    ["ur5x", "ur7", "ur20", "fr2", "xarm5", "panda2", "iiwa7", "gen4", "z2", "dh6", "kinova_gen3",
     "tiago_pro", "talos_right_arm", "canadarm", "canadarm3", "so102"],
)  # fmt: skip
def test_another_model_is_no_typing_mistake(name):
    with pytest.raises(UnknownNameError) as caught:
        find_robot(name)
    assert caught.value.suggestion is None


@pytest.mark.parametrize(
    ("name", "meant"),
    [("UR-5", "ur5"), ("ru5", "ur5"), ("xamr7", "xarm7"), ("pnada", "panda"), ("ur_5E", "ur5e"),
     ("baxter", "baxter_left"), ("talos_left", "talos_left_arm"), ("canadrm2", "canadarm2")],
)  # fmt: skip
def test_typing_mistakes_in_the_letters_of_a_name(name, meant):
    with pytest.raises(UnknownNameError, match=rf"did you mean '{meant}'\?"):
        find_robot(name)


@pytest.mark.parametrize("name", ["", " ", "-", "a\0b", "x" * 5000, "\udcff"])
def test_names_that_nobody_has(name):
    with pytest.raises(UnknownNameError, match="unknown robot or file"):
        load_robot(name)


def test_a_name_wins_over_a_file_and_a_path_over_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("panda", "mine"):
        write(tmp_path, arm(), name=name)
    assert load_robot("panda").n == 7
    for path in ("mine", "./panda", str(tmp_path / "panda"), Path("panda")):
        assert load_robot(path).names == ("j1", "j2", "j3", "j4")


def test_without_the_models_the_message_says_what_to_install(fresh, monkeypatch):
    def missing(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.distribution", missing)
    with pytest.raises(FtforceError, match=re.escape("`pip install example-robot-data`")):
        load_robot("panda")


def test_a_path_needs_no_models(fresh, monkeypatch, tmp_path):
    monkeypatch.setattr(registry, "_EXAMPLE_ROBOTS", Path("nowhere"))
    assert load_robot(write(tmp_path, arm())).n == 4
    assert load_robot(str(write(tmp_path, arm()))).n == 4
    with pytest.raises(FtforceError, match="the robot models are missing"):
        known_robots()


def test_the_folder_of_an_installed_package_is_found(monkeypatch, tmp_path):
    (tmp_path / "ftforce").mkdir()
    file = tmp_path / "ftforce" / "robot" / "known_robots.py"
    monkeypatch.setattr(registry, "__file__", str(file))
    assert robots_folder() == tmp_path / "robots"
    (tmp_path / "ftforce" / "robots").mkdir()
    assert robots_folder() == tmp_path / "ftforce" / "robots"
