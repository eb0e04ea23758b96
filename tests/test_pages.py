"""docs/examples/pages.py, which runs what the documentation tells a reader to type."""

from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"


@pytest.fixture
def pages(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    import pages

    return pages


def page(*blocks):
    return "\n".join(f"Text.\n\n```{language}\n{body}\n```\n" for language, body in blocks)


def outcome(pages, text, shown=None):
    report = pages.Report()
    pages.run_page("page", text, pages.steps(text, EXAMPLES), shown or {}, report)
    return report


def test_blocks_in_order(pages, tmp_path):
    (tmp_path / "s.txt").write_text("$ ftforce robots\nname\n$ ftforce inspect dh5\nRobot\n")
    text = page(
        ("console", "$ ftforce a && ftforce b\noutput\n$ ftforce c"),
        ("text", "ftforce not this"),
        ("{literalinclude} s.txt", ":language: text"),
        ("{literalinclude} s.txt", ':start-at: "$ ftforce inspect"'),
        ("{literalinclude} s.txt", ":end-before: $ ftforce inspect"),
        ("pycon", ">>> 1"),
        ("console", "cat > x << END\na\nEND\nftforce d"),
        ("bash", "#!/bin/bash\nftforce e\nftforce f"),
    )
    found = pages.steps(text, tmp_path)
    assert [step.text.strip() for step in found] == [
        *("ftforce a", "ftforce b", "ftforce c", "ftforce robots", "ftforce inspect dh5"),
        *("ftforce inspect dh5", "ftforce robots", ">>> 1"),
        *("cat > x << END\na\nEND", "ftforce d", "#!/bin/bash\nftforce e\nftforce f"),
    ]
    assert [step.kind for step in found].count("doctest") == 1
    assert found[0].line == text.splitlines().index("```console") + 1


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("```sh\nls\n```", "'sh'"),
        ("```text\nls", "end"),
        ("````{container} x\n```console\nls\n```\n````", "inside"),
    ],
)
def test_unknown_blocks_are_errors(pages, text, part):
    with pytest.raises(pages.PageError, match=part):
        pages.steps(text, EXAMPLES)


BROKEN = {
    "a wrong option": page(("console", "ftforce analyze dh5 --lock 3")),
    "a missing file": page(("console", "ftforce analyze dh5 --locked 3 --limits motors.csv")),
    "another program": page(("console", "false")),
    "an example": page(("pycon", ">>> 1 + 1\n3")),
    "an exception": page(("python", "missing")),
}


@pytest.mark.parametrize("text", BROKEN.values(), ids=BROKEN)
def test_what_fails_is_reported(pages, text):
    report = outcome(pages, text)
    assert report.run == 1
    assert len(report.failed) == 1
    assert report.failed[0].startswith("page:3: ")


def test_steps_share_folder_and_names(pages):
    text = page(
        ("console", "$ ftforce analyze dh5 --locked 3 -o a.json\n$ ftforce robots > robots.txt"),
        ("python", "n = len(open('robots.txt').read())"),
        (
            "pycon",
            ">>> import json\n>>> json.load(open('a.json'))['locked'], n > 0\n(['joint3'], True)",
        ),
    )
    report = outcome(pages, text)
    assert (report.run, report.failed) == (4, [])


def test_a_page_finds_only_the_files_that_it_names(pages):
    text = page(("console", "ftforce analyze panda --free 4 --friction motors.csv"))
    assert outcome(pages, text).failed
    assert not outcome(pages, f"See `docs/examples/motors.csv`.\n{text}").failed


def test_outputs_are_compared_with_sessions(pages):
    command = "ftforce analyze dh5 --locked elbow"
    _, output = pages.run(command)
    text = page(("console", command))
    assert outcome(pages, text).failed  # no session says that it is refused
    assert not outcome(pages, text, {command: output}).failed
    assert outcome(pages, text, {command: output.replace("joint5", "joint6")}).failed


def test_marks_are_noted(pages):
    report = outcome(pages, page(("console", "pip install nothing-of-this-name")))
    assert (report.run, report.failed, len(report.marks)) == (0, [], 1)
