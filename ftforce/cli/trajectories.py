"""Options of the commands that follow a trajectory, and their interpretation."""

from typing import TYPE_CHECKING, Annotated

import typer

from ftforce.cli.options import numbers
from ftforce.errors import InputError

if TYPE_CHECKING:
    from ftforce.robot.posture import Posture
    from ftforce.robot.robot import Robot
    from ftforce.trajectory.start import Trajectory

TrajectoryArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="[TRAJECTORY]",
        help="A CSV file: t and the joints' positions, or waypoints x,y,z. Or give --to.",
        show_default=False,
    ),
]
From = Annotated[
    str | None,
    typer.Option(
        "--from",
        metavar="X,Y,Z",
        help="Where the tip starts, m, in the root's axes; without it where the posture has it.",
    ),
]
To = Annotated[
    list[str] | None,
    typer.Option(
        metavar="X,Y,Z", help="Where it goes in a straight line, m; repeat it for more corners."
    ),
]
Speed = Annotated[
    float | None, typer.Option(metavar="M/S", help="Largest speed of the tip along its lines.")
]
KeepOrientation = Annotated[
    bool, typer.Option("--keep-orientation", help="The tip must not turn along its lines.")
]
Rate = Annotated[
    float | None,
    typer.Option(metavar="HZ", help="Samples per second; without it 100, and a recording's own."),
]
MaxGap = Annotated[
    float | None,
    typer.Option(
        metavar="S", help="Longest gap of a recording; without it ten times its usual step."
    ),
]


def place_of(
    robot: "Robot", file: str | None, q: str | None, posture: str | None, *, degrees: bool
) -> "Posture | None":
    """Return the posture near which a path starts; ``None`` if a file may determine it."""
    if file is not None and q is None and posture is None:
        return None
    from ftforce.robot.posture import choose_posture

    return choose_posture(robot, numbers(q, "--q"), posture, degrees=degrees)


def trajectory_of(
    robot: "Robot",
    file: str | None,
    start: str | None,
    corners: list[str] | None,
    *,
    speed: float | None,
    keep_orientation: bool,
    place: "Posture | None",
) -> "Trajectory":
    """Return the trajectory specified on the command line.

    Raises
    ------
    InputError
        No trajectory is specified, or more than one.
    """
    if file is not None:
        if start is not None or corners:
            raise InputError("give either a file of a trajectory or --from and --to, not both")
        return file
    if not corners:
        raise InputError(
            "where does the tip go? Give --to X,Y,Z --speed M/S, or a CSV file of a trajectory"
        )
    if speed is None:
        raise InputError("how fast? Give --speed, the largest speed of the tip in m/s")
    from ftforce.trajectory.path import Path
    from ftforce.trajectory.start import tip_at

    points = [_point(corner, "--to") for corner in corners]
    first = tip_at(robot, place, None).tolist() if start is None else _point(start, "--from")
    return Path.through([first, *points], speed=speed, keep_orientation=keep_orientation)


def _point(text: str, option: str) -> list[float]:
    point = numbers(text, option)
    if point is None or len(point) != 3:
        raise InputError(f"{option} needs x,y,z in m, got {text!r}")
    return point
