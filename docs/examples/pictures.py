"""Make every output that the README and the documentation show, or check that they are current.

``python docs/examples/pictures.py`` writes ``docs/pictures``. With ``--check`` nothing is written:
the exit status is 1 if a committed file differs from what the code prints now (numbers may differ
by rounding). Sessions are then compared by ``pages.py``, which runs them where a page shows them.
What matplotlib draws has scripts of its own: its bytes depend on its version.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import runpy
import shutil
import sys
import tempfile
from pathlib import Path

from pages import HERE, PICTURES, ROOT, commands, is_same, run

# Pictures of a terminal: name, command.
WINDOWS = {
    "locked-2-4": "analyze robots/dh5.urdf --locked 2,4",
    "paper": "analyze dh5 --locked 2,4,5 --force 80,50,10",
    "census": "census panda --faults 2 --top 6",
    "census-rail": "census rail_arm.urdf --faults 2 --force 0,0,60 --axes world",
    "free-limits": "analyze panda --free 4 --payload 2 --limits urdf --force 0,0,-70 --axes world",
    "mode-locked": "analyze panda --locked 2,4 --force 0,0,-50 --axes world",
    "mode-free": "analyze panda --free 4 --force 0,0,-50 --axes world",
    "mode-weak": "analyze panda --weak 4:0.3 --force 0,0,30 --axes world",
    "capability": "capability panda --locked 2,4 --limits panda_limits.toml --axes world",
}

_LINE = "plan panda --from 0.5,-0.2,0.4 --to 0.5,0.2,0.4 --speed 0.1 --keep-orientation"
# Terminal sessions as text: name, commands.
SESSIONS = {
    "tutorial-dh": ["dh rail_arm.toml"],
    "tutorial-inspect": ["inspect rail_arm.urdf"],
    "tutorial-analyze": ["analyze rail_arm.urdf --locked shoulder"],
    "tutorial-force": ["analyze rail_arm.urdf --locked rail --force 0,0,60 --axes world"],
    "tutorial-two": ["analyze rail_arm.urdf --locked 1,2 --force 0,0,60 --axes world"],
    "tutorial-posture": [
        "analyze rail_arm.urdf --q 0.4,0,0,1,0 --deg --locked wrist --force 60,0,0 --axes world"
    ],
    "tutorial-limits": [
        "analyze rail_arm.urdf --locked rail --force 0,0,60 --axes world --payload 3 --limits urdf"
    ],
    "tutorial-capability": ["capability rail_arm.urdf --locked rail --axes world"],
    "chain-branches": ["inspect two_arms.urdf"],
    "chain-chosen": ["inspect two_arms.urdf --tip left_tool --base torso"],
    "chain-joint": ["analyze dh5 --locked elbow", "analyze panda --locked panda_finger_joint1"],
    "posture-degrees": ["analyze dh5 --q 10,70,25,65,0 --locked 3 --force 80,50,10"],
    "verdict-pan": ["analyze panda --locked 2,4 --force 0,0,50"],
    "verdict-strict": ["analyze panda --locked 2,4 --force 0,50,0"],
    "moments": [
        "analyze pr2_left --locked 4 --task wrench --length 0.2 --force 0,0,30,0,5,0",
    ],
    "moments-short": ["analyze dh5 --locked 3 --task wrench --length 0.2"],
    "torque": ["analyze dh5 --locked 3 --torque -35,-12,27,10,4"],
    "velocity": ["analyze dh5 --locked 3 --force 80,50,10 --velocity 0.05,0.4,0.2,0.1,0.3"],
    "mode-friction": ["analyze panda --free 7 --force 0,0,-50 --axes world"],
    "mode-falls": ["analyze panda --free 2,4,6 --force 0,0,-50 --axes world"],
    "mode-mixed": ["analyze panda --locked 2 --free 4 --weak 6:0.1 --force 0,0,-50 --axes world"],
    "mode-census": ["census panda --mode free --force 0,0,-50 --axes world"],
    "weight": ["analyze panda --locked 4 --payload 2 --force 0,0,-50 --axes world"],
    "weight-motion": [
        "analyze panda --locked 4 --velocity 0.1,0.2,0,-0.3,0,0.2,0 --acceleration 0,0,0,1,0,0,0"
    ],
    "weight-none": ["analyze bare.urdf --locked 3 --force 80,50,10"],
    "limits": [
        "analyze panda --locked 2 --limits panda_limits.toml --force 80,0,-50 --axes world",
    ],
    "limits-unknown": [
        "analyze panda --locked 2 --limits motors.csv --force 80,0,-50 --axes world",
    ],
    "limits-carry": ["analyze panda --weak 4:0.2 --axes world"],
    "limits-falls": ["analyze panda --weak 2:0.03,4:0.1 --task fx,fy --axes world"],
    "inverse-euclidean": ["analyze panda --locked 1 --torque 5,15,0,-24,0,-4,0"],
    "inverse-dynamic": ["analyze panda --locked 1 --torque 5,15,0,-24,0,-4,0 --inverse dynamic"],
    "capability-free": ["capability panda --free 4 --axes world --direction 0,0,-1"],
    "capability-census": [
        "census panda --rank-by capability --faults 2 --top 6 --direction 0,0,-1 --axes world"
    ],
    "simulate-panda": [
        "simulate panda --to 0.4,0.3,0.4 --speed 0.2 --force 0,0,30 --fault 4@1",
    ],
    "simulate-free": [
        "simulate panda --to 0.4,0.3,0.4 --speed 0.2 --force 0,0,30 --fault free:4@1",
    ],
    "simulate-paper": ["simulate --paper"],
    "timeline": [
        "timeline panda --to 0.4,0.3,0.4 --speed 0.2 --rate 20 --mode free --force 0,0,30",
    ],
    "posture": ["posture panda --like default"],
    "reach": ["reach panda --soften --release"],
    "plan": [_LINE],
    "plan-locked": [f"{_LINE} --locked 4@1s"],
    "plan-guarantee": [f"{_LINE} --guarantee"],
    "sweep": ["sweep panda --samples 100000 --faults 2 --force 0,0,50 --top 8"],
    "workspace-map": [
        "sweep tiago --samples 131072 --force 0,0,50 --keep summary -o tiago.zarr",
        "map tiago.zarr",
    ],
    "compare": ["compare panda kinova ur5 dh5 --force 0,0,50"],
    "robots": ["robots"],
    "replicate": ["replicate"],
}

# Documents as a file holds them: file name, command.
DOCUMENTS = {
    "paper.json": "analyze dh5 --locked 2,4,5 --force 80,50,10",
    "paper.csv": "analyze dh5 --locked 2,4,5 --force 80,50,10",
    "census.csv": "census dh5 --force 80,50,10",
    "capability.csv": "capability dh5 --locked 3 --task fx,fz",
}

# What their commands take, of this folder.
FILES = ("rail_arm.toml", "panda_limits.toml", "motors.csv", "two_arms.urdf", "bare.urdf")

# What the other scripts of this folder draw.
DRAWN = {
    "architecture.svg",
    *("fault-modes.svg", "section-v.svg", "closed-loop.svg", "timeline.svg"),
    *("plan.svg", "plan-lock.svg", "posture.svg", "reach.svg"),
    *("plot-simulation.svg", "plot-census.svg", "plot-capability.svg", "plot-compare.svg"),
    *("front-polytope.svg", "front-fault.svg", "front-timeline.svg"),
    *("front-map.svg", "front-compare.svg"),
    *("map-panda.svg", "map-tiago.svg", "map-solid.svg"),
    *("view-locked.png", "view-lost.png", "view-moments.png"),
    *("view-census.png", "view-history.png", "view-sweep.png"),
}

# What these scripts print.
SCRIPTS = ("paper_case", "your_own_jacobian")


def printed(command: str) -> str:
    """Run ``ftforce COMMAND`` and return what it prints."""
    status, output = run(f"ftforce {command}")
    if status and not output.startswith("error: "):
        raise SystemExit(f"ftforce {command}: exit status {status}\n{output}")
    return output


def session(lines: list[str]) -> str:
    """Return commands with their outputs, as a terminal shows them."""
    return "\n".join(f"$ ftforce {line}\n{printed(line)}" for line in lines)


def printed_by(script: Path) -> str:
    """Run a script and return what it prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        runpy.run_path(str(script), run_name="__main__")
    return out.getvalue()


def make(folder: Path, *, with_sessions: bool) -> None:
    """Write the files into ``folder``; the commands run in a scratch folder of their own."""
    with tempfile.TemporaryDirectory() as scratch, contextlib.chdir(scratch):
        shutil.copytree(ROOT / "robots", "robots")
        for name in FILES:
            shutil.copy(HERE / name, name)
        if not with_sessions:
            printed("dh rail_arm.toml")  # which is one of the sessions
        for name, lines in SESSIONS.items() if with_sessions else ():
            (folder / f"{name}.txt").write_text(session(lines), "utf-8")
        for name, command in WINDOWS.items():
            printed(f"{command} -o {name}.svg")
            shutil.copy(f"{name}.svg", folder)
        for name, command in DOCUMENTS.items():
            printed(f"{command} -o {name}")
            shutil.copy(name, folder)
        for name in SCRIPTS:
            (folder / f"{name}.txt").write_text(printed_by(HERE / f"{name}.py"), "utf-8")


def differences(committed: Path) -> list[str]:
    """Return what is wrong with the committed files."""
    found = []
    with tempfile.TemporaryDirectory() as scratch:
        current = Path(scratch)
        make(current, with_sessions=False)
        made_elsewhere = DRAWN | {f"{name}.txt" for name in SESSIONS}
        names = {file.name for file in (*committed.iterdir(), *current.iterdir())} | made_elsewhere
        for name in sorted(names):
            if not (committed / name).exists():
                found.append(f"{name}: missing")
            elif name in made_elsewhere:
                continue
            elif not (current / name).exists():
                found.append(f"{name}: nothing makes this file")
            elif not is_same(*((f / name).read_text("utf-8") for f in (committed, current))):
                found.append(f"{name}: differs from what is printed now")
    return found


def other_sessions(committed: Path) -> list[str]:
    """Return the committed sessions that are not of the commands named here."""
    found = []
    for name, lines in SESSIONS.items():
        path = committed / f"{name}.txt"
        shown = path.read_text("utf-8").splitlines() if path.exists() else []
        if commands(shown, prompt=True) != [f"ftforce {line}" for line in lines]:
            found.append(f"{path.name}: shows other commands than SESSIONS has")
    return found


def main() -> None:
    """Write the files, or check them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--check", nargs="?", const=PICTURES, type=Path, metavar="DIR",
        help="write nothing; exit 1 if a file in DIR (docs/pictures) differs",
    )  # fmt: skip
    check = parser.parse_args().check
    os.environ.pop("FORCE_COLOR", None)
    if check is None:
        PICTURES.mkdir(exist_ok=True)
        make(PICTURES, with_sessions=True)
        return
    found = [*differences(check), *other_sessions(check)]
    print("\n".join(found) or "every picture is current")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
