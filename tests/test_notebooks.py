"""Results in a notebook: shown once, and in one line where a line is asked for."""

import contextlib
import io
import re

import numpy as np
import pytest
from IPython.core.displayhook import DisplayHook
from IPython.core.displaypub import CapturingDisplayPublisher
from IPython.core.interactiveshell import InteractiveShell
from traitlets import Type

import ftforce
from ftforce.analysis.paper import replicate
from ftforce.batch.workspace_map import workspace_map
from ftforce.show import render
from ftforce.trajectory.path import Path
from ftforce.trajectory.start import tip_at


class Output(DisplayHook):
    """The output of a cell, which a notebook publishes as it does what is displayed before."""

    def write_output_prompt(self):
        pass

    def write_format_data(self, format_dict, md_dict=None):
        self.shell.display_pub.publish(format_dict, md_dict)


class ZMQInteractiveShell(InteractiveShell):
    """A notebook's shell, by whose name rich and others know that they are in one."""

    displayhook_class = Type(Output)
    display_pub_class = Type(CapturingDisplayPublisher)


@pytest.fixture
def notebook():
    shell = ZMQInteractiveShell.instance()
    shell.display_formatter.active_types = ["text/plain", "text/html"]
    yield shell
    ZMQInteractiveShell.clear_instance()


def run(notebook, cell, **names):
    """Execute a cell; return what it shows, and what it prints."""
    notebook.display_pub.outputs.clear()
    notebook.push(names)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        assert notebook.run_cell(cell).success
    return [output["data"] for output in notebook.display_pub.outputs], printed.getvalue()


@pytest.fixture(scope="module")
def results():
    arm = ftforce.load_robot("dh5")
    first = np.array(tip_at(arm, None, None))
    path = Path.through([first, first + np.array([0.0, 0.05, 0.0])], speed=0.1)
    analysis = ftforce.analyze(arm, locked=[3], force=[80, 50, 10])
    sweep = ftforce.sweep(arm, n=64, threads=1)
    return {
        "Robot": arm,
        "Analysis": analysis,
        "Capability": ftforce.capability(arm, locked=[3]),
        "Census": ftforce.census(arm),
        "Comparison": ftforce.compare(["dh5", "kinova"], n=64, threads=1),
        "History": ftforce.simulate(arm, path, force=[8, 5, 1], faults="3@0.1", rate=50),
        "Remap": ftforce.remap(analysis.J, analysis.J.T @ [80.0, 50.0, 10.0], np.arange(5) == 2),
        "Replication": replicate(),
        "Sweep": sweep,
        "Timeline": ftforce.timeline(arm, path, rate=20),
        "WorkspaceMap": workspace_map(sweep),
    }


# What a line says of each; the verdict is that of the result.
SAID = {
    "Robot": "<Robot 'dh5': 5 joints",
    "Analysis": "<Analysis 'dh5': Not tolerated: with joint3 locked, 80.00 N of 94.87 N",
    "Capability": "<Capability 'dh5': With joint3 locked, no motor torque can produce force along",
    "Census": "<Census 'dh5', 5 locked sets: Critical joint: 3 joint3. Its fault is not tolerated>",
    "Comparison": "<Comparison of 2 arms: ",
    "History": "<History 'dh5', 48 instants: Borderline, and off the path: with 3 joint3 locked",
    "Remap": "<Remap of 5 joints, 1 locked: the force 94.87 jumps by 80.00>",
    "Replication": "91 pass, 8 explained by errata, 0 fail>",
    "Sweep": " of 64 postures keep every direction of force whichever joint locks",
    "Timeline": "<Timeline 'dh5', 20 instants: Not tolerated. Worst: 3 joint3 locked, at 0 s: ",
    "WorkspaceMap": " of 64 postures tolerate the fault",
}


@pytest.mark.parametrize("kind", SAID)
def test_a_cell_shows_a_result_once(notebook, results, kind):
    (shown,), printed = run(notebook, "result", result=results[kind])
    assert printed.strip() == ""
    line = shown["text/plain"]
    assert SAID[kind] in line
    assert "\n" not in line
    assert len(line) < 400
    # The same tables as in a terminal, and nothing else.
    html = shown["text/html"]
    plain = re.sub(r"<[^>]*>", "", html).replace("&lt;", "<").replace("&gt;", ">")
    plain = plain.replace("&#x27;", "'").replace("&quot;", '"').replace("&amp;", "&")
    wanted = render.to_text(results[kind], width=100)
    assert [line.rstrip() for line in plain.splitlines()] == wanted.splitlines()


def test_what_is_written_in_a_notebook_is_not_shown(notebook, results):
    """rich shows what a recording console prints, if it takes a file for a notebook."""
    for call in ("to_text(result)", "to_svg(result, 'x')", "to_page(result, 'x')"):
        cell = f"text = render.{call}"
        assert run(notebook, cell, result=results["Analysis"], render=render) == ([], "")


def test_several_results_are_a_line_each(results):
    texts = [*map(repr, results.values()), *map(repr, results["History"].runs.values())]
    assert all("\n" not in text for text in texts)
    assert sum(map(len, texts)) < 5000
    assert repr(list(results.values())) == f"[{', '.join(texts[: len(results)])}]"
