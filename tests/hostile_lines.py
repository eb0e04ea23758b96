"""Random command lines over all commands, options and files, usual and malformed.

A line is drawn from its number alone, so that one can be repeated. Its options are those that the
program declares; what each may get is listed here by name.
"""

from __future__ import annotations

import os
import random
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import typer

import ftforce
from ftforce import cli
from ftforce.io.bag import trajectory_bag
from ftforce.robot.known_robots import known_robots
from ftforce.trajectory import Path as TipPath
from mjcf_arms import ARMS

DH5 = known_robots()["dh5"].urdf
NAMES = [f"joint{i}" for i in range(1, 6)]
HEADER = ",".join(NAMES)
Q = "0.2,1.0,0.4,1.0,0.1"


def write_inputs(folder: Path) -> None:
    """Write files of every kind that a command reads, and files that are none."""
    for path in (DH5, DH5.with_suffix(".srdf"), DH5.with_suffix(".toml")):
        shutil.copyfile(path, folder / f"arm{path.suffix}")
    moved = "\n".join(f"{0.1 * i:.1f},{Q[:-1]}{i}" for i in range(8))
    shutil.copyfile(folder / "arm.toml", folder / "table.toml")  # of which there is no URDF
    texts = {
        "rec.csv": f"t,{HEADER}\n{moved}\n",
        "way.csv": "x,y,z\n0.9,0.3,0.2\n0.88,0.31,0.21\n",
        "q.csv": f"{HEADER}\n{Q}\n0,1,0.5,1,0\n",
        "deg.csv": f"{HEADER}\n10,50,20,50,0\n",
        "cut.csv": f"{HEADER}\n{Q}\n0,1,0.5",
        "nan.csv": f"{HEADER}\n0,nan,0,0,0\n",
        "limits.csv": "joint,effort,brake\n" + "".join(f"{x},60,90\n" for x in NAMES),
        "limits.toml": "".join(f"{x} = 50\n" for x in NAMES),
        "limits.yaml": "joint_limits:\n"
        + "".join(f"  {x}: {{max_effort: 50, min_effort: -20, damping: 1}}\n" for x in NAMES),
        "tool.toml": "mass = 2\ncentre = [0, 0, 0.1]\ninertia = [0.1, 0.1, 0.05, 0, 0, 0.01]\n",
        "bomb.yaml": "a: &a [1]\nb: [*a, *a]\n",
        "friction.csv": "joint,friction\n" + "".join(f"{x},0.1\n" for x in NAMES),
        "cut.urdf": DH5.read_text()[:900],
        "cut.toml": DH5.with_suffix(".toml").read_text()[:300],
        "arm.xml": ARMS["iiwa14"],
        "cut.xml": ARMS["panda"][:-900],
        "arm.urdf.xacro": DH5.read_text().replace('name="dh5"', 'name="$(arg name)"', 1),
        "empty.csv": "",
        "empty.urdf": "",
        "bad.json": '{"a": NaN',
        "évil $x$ [red]\n.csv": f"{HEADER}\n{Q}\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "noise.bin").write_bytes(random.Random(1).randbytes(3000))
    (folder / "folder").mkdir()
    (folder / "loop").symlink_to("loop")
    (folder / "link.urdf").symlink_to("arm.urdf")
    os.mkfifo(folder / "pipe")
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (40, 5))
    np.save(folder / "q.npy", q)
    bag = trajectory_bag([f"joint{i}" for i in range(1, 6)], np.arange(40) * 0.05, {"positions": q})
    (folder / "rec.mcap").write_bytes(bag)
    (folder / "cut.mcap").write_bytes(bag[:900])
    np.save(folder / "text.npy", np.array(["a"]))
    arm = ftforce.load_robot("dh5")
    asked = {"force": [8.0, 5.0, 1.0], "output": folder / "stored.zarr", "cell": 1.0, "threads": 1}
    asked["keep"] = "all"
    ftforce.sweep(arm, q, **asked)
    line = TipPath.through([(0.9, 0.3, 0.2), (0.88, 0.31, 0.21)], speed=0.2)
    run = ftforce.simulate(arm, line, force=[8, 5, 1], faults="3@0.05", rate=50)
    for name in ("run.npz", "run.csv", "run.parquet"):
        ftforce.save(run, folder / name)
    (folder / "cut.npz").write_bytes((folder / "run.npz").read_bytes()[:5000])
    shutil.copytree(folder / "stored.zarr", folder / "cut.zarr")
    shutil.rmtree(folder / "cut.zarr" / "verdict")


WRONG_FILES = (
    *("nowhere.csv", "empty.csv", "empty.urdf", "noise.bin", "folder", "loop", "pipe", "bad.json"),
    *(
        "cut.csv",
        "cut.urdf",
        "cut.xml",
        "cut.toml",
        "cut.npz",
        "cut.zarr",
        "text.npy",
        "nan.csv",
        ".",
    ),
    *("/dev/null", "/dev/zero", "/proc/self/mem", "x" * 300, "évil $x$ [red]\n.csv", "--", "-"),
)
WRONG = (
    *("", " ", ",", "x", "nan", "inf", "-inf", "1e400", "1,2", "1,,2", "1;2", "0x10", "1_0", "١"),
    *("\x1b[31m", "a\nb", "$x$", "[red]", "=1+1", "é", "9" * 400, "-1", "0", "1e308", "1e-320"),
    *("urdf", "none", "/etc/passwd", "--help", "1@", "@1", "1:", ":1", "true", "%s", "{0}"),
)
VECTORS = ("1,0,0", "0,0,-5", "0.3,-2,1e-3", "0,0,0", "1 2 3", "1e-9,0,0", "1,2,3,4,5", "1,2", "5")
JOINTS = ("1", "2,4", "joint3", "1,2,3,4,5", "5,joint1", "9", "joint", "1,1", "0")
ROBOTS = (
    "arm.xml",
    "arm.urdf.xacro",
    "arm.urdf",
    "arm.urdf",
    "arm.toml",
    "link.urdf",
    "dh5",
    "dh5",
    "panda",
    "ur5",
)
ENDINGS = (
    "json",
    "csv",
    "xlsx",
    "tex",
    "md",
    "mcap",
    "txt",
    "svg",
    "html",
    "npz",
    "parquet",
    "zarr",
    "png",
    "",
    "json.bak",
)
OUT = tuple(f"out.{ending}" for ending in ENDINGS)
READ = "<a file that the line reads>"
NO_OUT = ("no/out.json", "folder", "/dev/full", READ, READ, READ)
PLOTS = ("out.svg", "plot.svg", "plot.svg", "plot.png", "plot.pdf", "plot.gif")
PLACES = ("0.9,0.3,0.2", "0.9,0.28,0.22", "5,5,5", "0,0,0", "1,2")
POSTURES = ("paper", "zero", "bent", "sample", "mid-range", "nowhere")
NUMBERS = ("0.5", "1", "0.1", "0", "1e-9", "1e9", "-1", "3.7")
VALUES: dict[str, tuple[str, ...]] = {
    "robot": (*ROBOTS, "pand", "nowhere.urdf"),
    "trajectory": ("rec.csv", "rec.csv", "way.csv", "q.csv", "run.csv", "rec.mcap", "cut.mcap"),
    "topic": ("/joint_states", "/nowhere", "joint_states"),
    "sweep": ("stored.zarr", "stored.zarr", "out.zarr"),
    "kernels": ("force", "remapper", "forces"),
    "history": ("run.npz", "run.csv", "run.parquet"),
    "table": ("table.toml", "arm.toml", "limits.toml"),
    "postures": ("q.csv", "q.npy", "deg.csv", "rec.csv", "rec.mcap", "cut.mcap"),
    "limits": (
        "urdf",
        "none",
        "limits.csv",
        "limits.toml",
        "friction.csv",
        "limits.yaml",
        "bomb.yaml",
    ),
    "friction": ("0.1", "0", "friction.csv", "limits.csv"),
    **dict.fromkeys(("locked", "free", "joints"), JOINTS),
    "weak": ("1:0.5", "joint2:0", "3:1", "2:1e-100", "2:2", "2"),
    "fault": ("2@0.05", "free:1@0.02", "1,2@0", "9@0.01", "weak:1:0.5@0.01", "2@9", "2"),
    "q": ("0,1,0.5,1,0", Q, "0,0,0,0,0", "10,50,20,50,0", "1e6,0,0,0,0", "1"),
    "posture": POSTURES,
    **dict.fromkeys(("force", "direction", "gravity"), VECTORS),
    **dict.fromkeys(("torque", "velocity", "acceleration"), ("1,2,3,4,5", "0,0,0,0,0", "1e9")),
    "inverse": ("euclidean", "dynamic", "newton"),
    "mounted": ("floor", "wall", "ceiling", "30,-45", "90", "upside down"),
    "payload": (
        "tool.toml",
        "arm.toml",
        "nowhere.toml",
        "2@0,0,0.1@1,1,1,0,0,0",
        "1",
        "0",
        "2@0.1,0,0",
        "1e9",
        "-1",
        "1e308",
        "1kg",
    ),
    "task": ("force", "moment", "wrench", "fx,fz", "fx", "my,fx", "fq"),
    "axes": ("tool", "world", "tip"),
    "base": ("base", "link1", "nowhere"),
    "tip": ("tool", "link3", "nowhere"),
    "args": ("name=arm", "length:=2", "name"),
    "srdf": ("arm.srdf", "arm.urdf", "link.urdf", "folder", "nowhere.srdf"),
    "package_path": (".", "folder", "nowhere"),
    "rtol": ("1e-6", "1e-3", "1e-9", "2", "0"),
    "wary": ("1e-2", "0.5", "1e-9"),
    "length": NUMBERS,
    "joint_length": NUMBERS,
    "faults": ("1", "2", "3", "0", "99", "-1"),
    "mode": ("locked", "free", "weak"),
    "rank_by": ("jump", "capability", "size"),
    "top": ("1", "5", "0"),
    "form": ("table", "json", "csv", "tex", "md", "xml"),
    "output": (*OUT, *OUT, *NO_OUT),
    "plot": (*PLOTS, *NO_OUT[:4]),
    "export": ("out.html", "out.htm", "out.txt"),
    "screenshot": ("out.jpg", "no/out.png"),
    "at": (*NUMBERS, "0.3,0.1,0.3", "0.4,0,0.4"),
    "host": ("127.0.0.1",),
    "port": ("0", "65536", "x"),
    "start": PLACES,
    "to": PLACES,
    "speed": ("0.2", "1", "0", "1e-9", "1e9", "-1"),
    "rate": ("20", "50", "0", "1e9", "1e-9"),
    "max_gap": NUMBERS,
    "maximize": ("margin", "rho", "capability", "payload", "jump", "speed"),
    "like": ("zero", "default", "0,0.1,-0.2,0.3,0.1", "nowhere", "1"),
    "rpy": ("0,0,0", "3,0,0.5", "1", "x"),
    "restarts": ("2", "4", "0", "-1", "1.5"),
    "within": ("no.toml", "limits.toml", "arm.urdf"),
    "around": ("0,0,0,1,1,1", "0,0,1,1", "1", "x"),
    "locks": ("2@0.1", "1@0.2,3@-0.1", "2@0.05s", "2", "9@1", "@", "1@x", "1@0.1,2@1s"),
    "waypoints": ("3", "4", "5", "1", "1.5", "-2"),
    "max_acceleration": ("50", "5,5,5,5,5", "1,2", "-1", "1e-9", "x"),
    "smooth": ("auto", "none", "0.1", "1e-9", "9"),
    "delay": ("0", "0.05", "-1", "1e9"),
    "samples": ("64", "64", "100", "1", "2.5", "0", "-5", "1e19"),
    "method": ("sobol", "uniform", "halton"),
    "seed": ("0", "7", "-1", "1.5", str(2**70)),
    "grid": ("1", "2", "2,1,2,1,2", "0", "1000000", "2,2"),
    "keep": ("all", "worst", "summary", "some"),
    "cell": ("0.5", "1", "0", "1e-9", "1e9"),
    "chunk": ("4096", "1", "0"),
    "threads": ("1", "2", "0", "100000"),
    "workers": ("0", "-1", "100000"),
    "scheduler": ("nonsense://x", "tcp://"),
    "plane": ("xy", "xz", "yz", "xx"),
    "quantity": ("rho", "margin", "jump", "capability", "rho,margin", "size"),
    "enough": ("0.95", "0.5", "2", "0"),
}
FILES = {"robot", "robots", "trajectory", "sweep", "history", "table", "postures", "limits"}
# Seldom: they take long, or make most of the other options an error.
SELDOM = {"plot": 0.05, "posture": 0.3, "q": 0.5, "base": 0.2, "tip": 0.2, "workers": 0.3}
SELDOM |= {"scheduler": 0.1, "torque": 0.3, "grid": 0.2, "postures": 0.3, "trajectory": 0.5}
ALWAYS = {"robot", "robots", "sweep", "table"}
SHARES = {"analyze": 10, "census": 8, "capability": 8, "inspect": 6, "dh": 6, "sweep": 3, "map": 3}
SHARES |= {
    "plan": 1,
    "timeline": 3,
    "simulate": 3,
    "compare": 1,
    "robots": 0.5,
    "replicate": 0.3,
    "view": 0.3,
}


@cache
def commands() -> dict[str, Any]:
    """Return the commands of the program."""
    found: dict[str, Any] = typer.main.get_command(cli.app).commands  # type: ignore[attr-defined]
    return found


def draw(number: int, command: str | None = None) -> list[str]:
    """Return the words of a command line.

    Parameters
    ----------
    number, command :
        Its number, and its command; by default any.
    """
    c = random.Random(f"line {number}")
    odd = c.choice((0.0, 0.0, 0.05, 0.3))
    command = command or c.choices(list(SHARES), list(SHARES.values()))[0]
    share = c.choice((0.05, 0.1, 0.2))
    words, read = [command], []
    for parameter in commands()[command].params:
        name = parameter.name
        is_argument = parameter.param_type_name == "argument"
        is_needed = is_argument and name in ALWAYS and c.random() > 0.3 * odd
        is_needed |= _is_needed(command, name) and c.random() > 0.1
        if not is_needed and c.random() > share * SELDOM.get(name, 1.0):
            continue
        option = [] if is_argument else [c.choice(parameter.opts)]
        if getattr(parameter, "is_flag", False):
            words += option if name not in {"help", "debug"} else []  # it shows tracebacks
            words += ["--export", "page.html"] if name == "open_page" else []  # else it stays open
            continue
        for _ in range(_count(c, name)):
            value = _value(c, name, odd)
            if value == READ:  # arguments come first
                value = c.choice(read or ["no/out.json"])
            words += [*option, value]
            read += [value] if name in FILES and Path(value).suffix else []
    if c.random() < 0.2 * odd:
        words.insert(c.randrange(len(words) + 1), c.choice((*WRONG, "--unknown", "-x", "--deg")))
    return words


def _is_needed(command: str, name: str) -> bool:
    if name in {"to", "speed"}:
        return command in {"simulate", "timeline", "plan"}
    if name == "force":
        return command == "simulate"
    if name == "kernels":  # all would take long to compile
        return True
    if name in {"waypoints", "restarts"}:  # a hundred would take long
        return True
    return name == ("samples" if command in {"sweep", "compare"} else "export") and command in {
        *("sweep", "compare", "view")
    }


def _count(c: random.Random, name: str) -> int:
    if name == "robots":
        return c.choice((1, 2, 2, 2, 3))
    return c.choice((1,) * 9 + (2,)) if name in {"locked", "output", "to", "fault", "weak"} else 1


def _value(c: random.Random, name: str, odd: float) -> str:
    if c.random() < odd:
        return c.choice(WRONG_FILES if name in FILES and c.random() < 0.7 else WRONG)
    if name == "robots":
        return c.choice((*ROBOTS, "stored.zarr"))
    usual = VALUES[name]
    return c.choice(usual if odd or c.random() < 0.3 else usual[: max(1, len(usual) // 2)])
