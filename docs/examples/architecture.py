"""Draw who imports whom, from the imports of the installed package, lazy and type-only ones too.

Run as it is it writes docs/pictures/architecture.svg; with ``--check`` it compares.
An arrow that runs upward would be red. What a chain of arrows implies is left out.
"""

from __future__ import annotations

import argparse
import sys
from html import escape
from pathlib import Path

import grimp

PICTURE = Path(__file__).parents[1] / "pictures" / "architecture.svg"
FLOORS = (  # from the top, as the contract in pyproject.toml has it
    ("cli",),
    ("view",),
    ("show",),
    ("report",),
    ("trajectory", "batch"),
    ("analysis",),
    ("robot",),
    ("io", "core"),
    ("errors",),
)
PROMISES = {
    "cli": "one file per command: parse, call, show",
    "view": "the page in the browser",
    "show": "terminal and print",
    "report": "a result as words, JSON and rows",
    "trajectory": "over time",
    "batch": "over postures",
    "analysis": "one posture: question in, answer out",
    "robot": "from a file or a name to a Robot",
    "io": "files, read and written safely",
    "core": "the mathematics, arrays only",
    "errors": "the tree of errors",
}
WIDTH, ROOM, FLOOR, GAP = 700, 300, 54, 30
HEAD = (
    '<marker id="a" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
    'markerUnits="userSpaceOnUse" orient="auto"><path d="M0 0 8 4 0 8z" fill="#4477aa"/></marker>'
)


def arrows() -> dict[tuple[str, str], int]:
    """Return how many imports lead from one package to another."""
    graph = grimp.build_graph("ftforce", exclude_type_checking_imports=False, cache_dir=None)
    counts: dict[tuple[str, str], int] = {}
    for module in graph.modules:
        for target in graph.find_modules_directly_imported_by(module):
            pair = (room_of(module), room_of(target))
            if pair[0] != pair[1] and set(pair) <= PROMISES.keys():
                counts[pair] = counts.get(pair, 0) + 1
    return counts


def room_of(module: str) -> str:
    return module.split(".")[1] if "." in module else module


def place(name: str) -> tuple[float, float]:
    """Return the middle of a room."""
    for row, floor in enumerate(FLOORS):
        if name in floor:
            step = ROOM + 2 * GAP
            x = WIDTH / 2 + (floor.index(name) - (len(floor) - 1) / 2) * step
            return x, GAP + row * (FLOOR + GAP) + FLOOR / 2
    raise KeyError(name)


def without_shortcuts(counts: dict[tuple[str, str], int]) -> set[tuple[str, str]]:
    """Return the arrows that say more than a chain of others does."""
    below: dict[str, set[str]] = {}
    for name in reversed([name for floor in FLOORS for name in floor]):
        targets = {target for source, target in counts if source == name}
        below[name] = targets.union(*(below.get(target, set()) for target in targets))
    return {
        (source, target)
        for source, target in counts
        if not any((source, via) in counts and target in below[via] for via in PROMISES)
    }


def draw(counts: dict[tuple[str, str], int]) -> str:
    """Return the drawing: rooms on floors, and the arrows that no chain of others implies."""
    height = GAP + len(FLOORS) * (FLOOR + GAP)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}">',
        "<title>Packages of ftforce, and who imports whom</title>",
        '<rect width="100%" height="100%" fill="#fff"/>',
        f"<defs>{HEAD}</defs>",
        '<g font-family="sans-serif" font-size="13">',
    ]
    for source, target in sorted(without_shortcuts(counts)):
        (x0, y0), (x1, y1) = place(source), place(target)
        colour = "#4477aa" if y1 > y0 else "#cc3311"
        parts.append(
            f'<path d="M{x0:.0f} {y0 + FLOOR / 2:.0f}L{x1:.0f} {y1 - FLOOR / 2 - 1:.0f}" '
            f'stroke="{colour}" stroke-width="2" marker-end="url(#a)">'
            f"<title>{source} imports {target} in {counts[source, target]} places</title></path>"
        )
    for floor in FLOORS:
        for name in floor:
            x, y = place(name)
            parts.append(
                f'<rect x="{x - ROOM / 2:.0f}" y="{y - FLOOR / 2:.0f}" width="{ROOM}" '
                f'height="{FLOOR}" rx="6" fill="#eef3f8" stroke="#4477aa"/>'
                f'<text x="{x:.0f}" y="{y - 5:.0f}" text-anchor="middle" font-weight="bold">'
                f'{name}</text><text x="{x:.0f}" y="{y + 15:.0f}" text-anchor="middle" '
                f'fill="#333">{escape(PROMISES[name])}</text>'
            )
    return "\n".join([*parts, "</g>", "</svg>", ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare, and write nothing")
    drawing = draw(arrows())
    if not parser.parse_args().check:
        PICTURE.write_text(drawing, encoding="utf-8")
    elif PICTURE.read_text(encoding="utf-8") != drawing:
        sys.exit(f"{PICTURE.name} shows other imports: run python docs/examples/architecture.py")


if __name__ == "__main__":
    main()
