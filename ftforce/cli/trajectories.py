"""Options of the commands that follow a trajectory."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ftforce.cli.options import Group, PostureOptions, numbers

if TYPE_CHECKING:
    from ftforce.robot.posture import Posture
    from ftforce.robot.robot import Robot


# Arguments of the question that decide whether it can be answered in a posture.
_QUESTION = ("force", "task", "length", "axes", "rtol", "wary")


class TrajectoryOptions(Group):
    """Trajectory from a file, or straight lines of the tip."""

    trajectory: Annotated[
        str | None,
        typer.Argument(
            metavar="TRAJECTORY",
            help="A CSV file (t and joint positions, or waypoints x,y,z) or a bag of ROS. Or give "
            "--to.",
            show_default=False,
        ),
    ] = None
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="X,Y,Z",
            help="Start of the tip, m, in root axes.",
            show_default="its initial position",
        ),
    ] = None
    to: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Next tip position in root axes, m, along a straight line; repeat for more.",
        ),
    ] = None
    speed: Annotated[
        float | None,
        typer.Option(metavar="M/S", help="Maximum tip speed along the path."),
    ] = None
    keep_orientation: Annotated[
        bool,
        typer.Option("--keep-orientation", help="Keep the orientation of the tip along the path."),
    ] = False
    rate: Annotated[
        float | None,
        typer.Option(
            metavar="HZ", help="Samples per second.", show_default="the recording's, else 100"
        ),
    ] = None
    max_gap: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Longest gap allowed in a recording, s.",
            show_default="ten times its median step",
        ),
    ] = None

    topic: Annotated[
        str | None,
        typer.Option(
            metavar="TOPIC",
            help="Topic of a bag that holds the motion.",
            show_default="the only one that has the joints",
        ),
    ] = None
    smooth: Annotated[
        str,
        typer.Option(
            metavar="auto|S|none",
            help="Smoothing of a recording: from its noise, by knots S seconds apart, or none.",
        ),
    ] = "auto"
    static: Annotated[
        bool,
        typer.Option("--static", help="Count the weight only, no velocities and accelerations."),
    ] = False

    def arguments_for(
        self, robot: "Robot", posture_options: PostureOptions, asked: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Return trajectory and posture as arguments of the functions behind the commands.

        Parameters
        ----------
        robot :
            The arm.
        posture_options :
            Posture near which a path starts; a recording has its own.
        asked :
            The other arguments, on which the default posture depends.

        Raises
        ------
        BadParameter
            No trajectory is given, or more than one.
        """
        is_file = self.trajectory is not None
        place = posture_options.of(robot)
        if place is None and not is_file:
            from ftforce.analysis.question import Question

            known = {name: asked[name] for name in _QUESTION if name in asked}
            place = Question.parse(robot, **known).placed().place
        return {
            "trajectory": self.trajectory if is_file else self._lines(robot, place),
            "q": place,
            "rate": self.rate,
            "speed": self.speed if is_file else None,
            "keep_orientation": self.keep_orientation and is_file,
            "max_gap": self.max_gap,
            "topic": self.topic,
            "smooth": self._smooth(),
            "static": self.static,
        }

    def _smooth(self) -> str | float:
        if self.smooth in {"auto", "none"}:
            return self.smooth
        found = numbers(self.smooth, "--smooth")
        if found is None or len(found) != 1:
            raise typer.BadParameter(
                f"--smooth must be auto, none or a time in s, got {self.smooth!r}"
            )
        return found[0]

    def _lines(self, robot: "Robot", place: "Posture | None") -> Any:
        if not self.to:
            raise typer.BadParameter(
                "the trajectory is missing: give --to X,Y,Z --speed M/S, or a CSV file"
            )
        if self.speed is None:
            raise typer.BadParameter("--speed is missing, the maximum speed of the tip in m/s")
        from ftforce.trajectory.path import Path
        from ftforce.trajectory.start import tip_at

        first = tip_at(robot, place, None).tolist()
        if self.start is not None:
            first = _point(self.start, "--from")
        points = [first, *(_point(corner, "--to") for corner in self.to)]
        return Path.through(points, speed=self.speed, keep_orientation=self.keep_orientation)

    def check(self) -> None:
        """Reject a file together with lines.

        Raises
        ------
        BadParameter
            Both are given.
        """
        if self.trajectory is not None and (self.start is not None or self.to):
            raise typer.BadParameter("give either a trajectory file or --from and --to, not both")


def _point(text: str, option: str) -> list[float]:
    point = numbers(text, option)
    if point is None or len(point) != 3:
        raise typer.BadParameter(f"{option} needs x,y,z in m, got {text!r}")
    return point
