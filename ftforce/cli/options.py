"""Options shared by commands, each declared once; parsing of vectors; handling of errors.

Options that belong together form a `Group`. A command names the group as a parameter; `guarded`
replaces it by the options of the group.

Exit status: 0 success; 1 a file is wrong, or a value does not fit the robot or the question; 2 the
command line itself is wrong, which can be told from its words alone; 130 interrupted.
"""

import functools
import inspect
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ftforce.cli.files import check_files
from ftforce.cli.output import Format, check_outputs, emit
from ftforce.cli.printing import silence
from ftforce.errors import (
    FtforceError,
    InputError,
    UnknownNameError,
    out_of_memory,
    printable,
)

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ftforce.core.faults import FaultSet
    from ftforce.robot.posture import Posture
    from ftforce.robot.robot import Robot

RobotArgument = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT",
        help="A URDF, a xacro file (.xacro), an MJCF file, a DH table (.toml), or a known name "
        "such as panda (see `ftforce robots`).",
    ),
]
_LIMITS_FILE = "the URDF's, or a TOML, YAML (MoveIt) or CSV file's."
TopOption = Annotated[
    int, typer.Option("--top", min=1, metavar="N", help="Number of fault sets shown in the table.")
]
ThreadsOption = Annotated[
    int | None,
    typer.Option(
        "--threads", metavar="N", help="Threads on this machine.", show_default="all processors"
    ),
]
MethodOption = Annotated[
    str,
    typer.Option(
        "--method", metavar="sobol|uniform", help="How postures are drawn within the joint limits."
    ),
]
SeedOption = Annotated[
    int,
    typer.Option(
        "--seed", metavar="N", help="Seed of the draw; the same seed gives the same postures."
    ),
]

_KEYWORD = inspect.Parameter.KEYWORD_ONLY

# Options of the question that hold numbers separated by commas.
_VECTORS = {"force", "torque", "direction", "velocity", "acceleration", "gravity"}


class Group(SimpleNamespace):
    """Options that several commands share; the annotated attributes are their declarations.

    No dataclass: generating the methods of some twenty classes would take a tenth of the time in
    which ``ftforce analyze`` answers.
    """

    def __init__(self, **given: Any) -> None:
        """Take the values of the options.

        Raises
        ------
        BadParameter
            Some exclude each other.
        """
        super().__init__(**given)
        self.check()

    def check(self) -> None:
        """Reject options that exclude each other."""

    @classmethod
    def options(cls) -> Iterator[inspect.Parameter]:
        """Yield the declared options, those of the base classes first."""
        declared: dict[str, Any] = {}
        for base in reversed(cls.__mro__):
            declared |= vars(base).get("__annotations__", {})
        for name, annotation in declared.items():
            default = getattr(cls, name)
            yield inspect.Parameter(name, _KEYWORD, default=default, annotation=annotation)

    def arguments(self) -> dict[str, Any]:
        """Return the options as arguments of the functions behind the commands.

        Raises
        ------
        BadParameter
            A vector is malformed.
        """
        return {
            name: numbers(value, f"--{name}") if name in _VECTORS else value
            for name, value in vars(self).items()
        }


class ChainOptions(Group):
    """Ends of the chain."""

    base: Annotated[
        str | None,
        typer.Option(
            metavar="LINK", help="Base link.", show_default="the robot's own, else the root"
        ),
    ] = None
    tip: Annotated[
        str | None,
        typer.Option(metavar="LINK", help="Tip link.", show_default="the robot's own"),
    ] = None
    args: Annotated[
        list[str] | None,
        typer.Option(
            "--arg",
            metavar="NAME=VALUE",
            help="Argument of a xacro file; repeat it for more.",
        ),
    ] = None
    package_path: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DIR",
            help="Where a xacro file's $(find PACKAGE) looks, at or below DIR, and what an MJCF "
            "file may include; repeat it for more.",
        ),
    ] = None

    srdf: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="SRDF with tip and postures.",
            show_default="beside the URDF, or of its MoveIt configuration",
        ),
    ] = None

    def arguments(self) -> dict[str, Any]:
        """Return the options as arguments of `ftforce.load_robot`.

        Raises
        ------
        BadParameter
            An argument of a xacro file is malformed.
        """
        return {**vars(self), "args": None if self.args is None else dict(map(_pair, self.args))}

    @property
    def is_given(self) -> bool:
        """Whether any of the options is given."""
        return any(value is not None for value in vars(self).values())

    def load(self, robot: str, posture: str | None = None) -> "Robot":
        """Load a robot with this chain.

        Parameters
        ----------
        robot :
            URDF file, DH table or known name.
        posture :
            Named posture at which joints outside the chain are held.
        """
        from ftforce.robot.load import load_robot

        return load_robot(robot, posture=posture, **self.arguments())


def _pair(text: str) -> tuple[str, str]:
    name, separator, value = text.replace(":=", "=", 1).partition("=")
    if not (name.strip() and separator):
        raise typer.BadParameter(f"--arg needs NAME=VALUE, got {printable(text)!r}")
    return name.strip(), value


class PostureOptions(Group):
    """Posture."""

    q: Annotated[
        str | None,
        typer.Option("--q", metavar="Q1,Q2,…", help="Joint positions along the chain, rad or m."),
    ] = None
    posture: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Named posture; also mid-range, zero, bent, sample."),
    ] = None
    deg: Annotated[
        bool,
        typer.Option(
            "--deg", help="Angles in --q are in degrees; in tables too, where they show q."
        ),
    ] = False

    def of(self, robot: "Robot") -> "Posture | None":
        """Return the given or the named posture of a robot; ``None`` for the default."""
        if not self.is_given:
            return None
        from ftforce.robot.posture import choose_posture

        return choose_posture(robot, numbers(self.q, "--q"), self.posture, degrees=self.deg)

    @property
    def is_given(self) -> bool:
        """Whether positions or a name are given."""
        return self.q is not None or self.posture is not None


class FaultOptions(Group):
    """One fault set."""

    locked: Annotated[
        list[str] | None,
        typer.Option(metavar="JOINTS", help="Locked joints: numbers from 1 or names, e.g. 2,4."),
    ] = None
    free: Annotated[
        list[str] | None,
        typer.Option(
            metavar="JOINTS", help="Free-swinging joints: neither motor nor brake applies torque."
        ),
    ] = None
    weak: Annotated[
        list[str] | None,
        typer.Option(
            metavar="JOINT:FACTOR",
            help="Weak joints, with the remaining fraction of their torque limit, e.g. 3:0.5.",
        ),
    ] = None

    def arguments(self) -> dict[str, Any]:
        """Return the options as arguments; each may be given several times.

        Raises
        ------
        BadParameter
            An item between commas is empty.
        """
        for name, words in vars(self).items():
            for word in words or ():
                items(word, f"--{name}")
        return {name: ",".join(words) if words else () for name, words in vars(self).items()}

    def of(self, robot: "Robot") -> "FaultSet":
        """Return the fault set of a robot."""
        from ftforce.analysis.fault_names import named_faults

        return named_faults(robot, **self.arguments())


class SetOptions(Group):
    """All fault sets up to a size."""

    faults: Annotated[int, typer.Option(metavar="N", help="Size of the largest fault sets.")] = 1
    mode: Annotated[str, typer.Option(metavar="locked|free", help="How the joints fail.")] = (
        "locked"
    )


_Force = Annotated[
    str | None,
    typer.Option(metavar="FX,FY,FZ", help="Force the tool exerts on its environment, N (and N·m)."),
]


class LoadOptions(Group):
    """Force at the tip, or the motor torques for it."""

    force: _Force = None
    torque: Annotated[
        str | None,
        typer.Option(
            metavar="T1,T2,…",
            help="Instead of a force: the motor torques for it, N·m, without weight and motion.",
        ),
    ] = None
    inverse: Annotated[
        str,
        typer.Option(
            metavar="euclidean|dynamic",
            help="Inverse that splits --torque into force and self-motion.",
        ),
    ] = "euclidean"

    def check(self) -> None:
        """Reject --force together with --torque."""
        if self.force is not None and self.torque is not None:
            raise typer.BadParameter("give either --force or --torque, not both")


_Direction = Annotated[
    str | None,
    typer.Option(metavar="X,Y,Z", help="Direction of the force capability, in task axes."),
]


class DirectionOption(Group):
    """Direction of the capability."""

    direction: _Direction = None


class ForceOptions(Group):
    """Force at the tip, and direction of the capability."""

    force: _Force = None
    direction: _Direction = None


class MotionOptions(Group):
    """Motion before the fault."""

    velocity: Annotated[
        str | None,
        typer.Option(metavar="V1,V2,…", help="Joint velocities before the fault, rad/s or m/s."),
    ] = None
    acceleration: Annotated[
        str | None,
        typer.Option(
            metavar="A1,A2,…", help="Joint accelerations before the fault, rad/s² or m/s²."
        ),
    ] = None


class WeightOptions(Group):
    """Gravity and payload."""

    gravity: Annotated[
        str | None,
        typer.Option(
            metavar="GX,GY,GZ",
            help="Gravity in root axes, m/s²; 0,0,0 in free fall.",
            show_default="the model's",
        ),
    ] = None
    mounted: Annotated[
        str | None,
        typer.Option(
            metavar="HOW",
            help="Instead of gravity: how the root is mounted: floor, ceiling, wall (its x axis "
            "points down), or ROLL,PITCH in degrees.",
        ),
    ] = None
    payload: Annotated[
        str | None,
        typer.Option(
            metavar="KG[@X,Y,Z]|FILE",
            help="Mass at the tip, kg, and its position in tip axes, m; or a TOML file "
            "(mass, centre, inertia).",
        ),
    ] = None

    def check(self) -> None:
        """Reject --gravity together with --mounted."""
        if self.gravity is not None and self.mounted is not None:
            raise typer.BadParameter("give either --gravity or --mounted, not both")

    def arguments(self) -> dict[str, Any]:
        """Return gravity and payload; how the root is mounted is a way to give gravity.

        Raises
        ------
        BadParameter
            Gravity is malformed.
        """
        given = super().arguments()
        mounted = given.pop("mounted")
        return given if mounted is None else given | {"gravity": mounted}


class LimitsOption(Group):
    """Torque limits, by default none unless the analysis needs them."""

    limits: Annotated[
        str | None,
        typer.Option(
            metavar="urdf|FILE|none",
            help=f"Torque limits to enforce: {_LIMITS_FILE}",
            show_default="none; urdf where needed",
        ),
    ] = None


class CapabilityLimits(Group):
    """Torque limits of the capability."""

    limits: Annotated[
        str | None,
        typer.Option(
            metavar="urdf|FILE|none", help=f"Torque limits of the capability: {_LIMITS_FILE}"
        ),
    ] = "urdf"


class FrictionOption(Group):
    """Friction of free-swinging joints."""

    friction: Annotated[
        str | None,
        typer.Option(
            metavar="N·m|FILE",
            help="Friction of free-swinging joints: a number, or a TOML, YAML or CSV file "
            "(joint,friction); 0 for ideal joints.",
            show_default="the URDF's, else 0.1 % of the effort limit",
        ),
    ] = None


class DriveOptions(Group):
    """Friction and rotor inertia of the drives of a moving arm."""

    joint_friction: Annotated[
        bool,
        typer.Option(
            "--joint-friction",
            help="Count the Coulomb and viscous friction of moving joints (<dynamics>, or the file "
            "of --limits).",
        ),
    ] = False
    armature: Annotated[
        bool,
        typer.Option(
            "--armature", help="Count the rotor inertia of the joints (<dynamics>, or that file)."
        ),
    ] = False


class TaskOptions(Group):
    """Components and axes of the force."""

    task: Annotated[
        str,
        typer.Option(
            metavar="force|moment|…",
            help="force, moment, wrench, or components such as fx,fz,my.",
        ),
    ] = "force"
    length: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Characteristic length, m, that weighs moments against forces.",
            show_default="1",
        ),
    ] = None
    joint_length: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="In a chain of hinges and slides: travel, m, that counts as much as 1 rad.",
            show_default="1",
        ),
    ] = None
    axes: Annotated[
        str,
        typer.Option(
            metavar="tool|world",
            help="tool: axes of the tip frame; world: root axes, at the tip point.",
        ),
    ] = "tool"


class RankTolerance(Group):
    """Tolerance of ranks."""

    rtol: Annotated[
        float,
        typer.Option(
            metavar="RTOL", help="Singular values up to RTOL × σ_max(J) are treated as 0."
        ),
    ] = 1e-6


class Tolerances(RankTolerance):
    """Tolerances of ranks and of the verdict."""

    wary: Annotated[
        float,
        typer.Option(
            metavar="RTOL",
            help="Borderline if some tolerance up to this one changes the verdict.",
        ),
    ] = 1e-2


_Form = Annotated[
    Format | None,
    typer.Option(
        "--format",
        metavar="table|json|csv|tex|md",
        help="Output format.",
        show_default="by the extension of --output, else table",
    ),
]


class Outputs(Group):
    """Where the result goes."""

    form: _Form = None
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="File to write (.json .csv .xlsx .tex .md .txt .svg .html); repeat it for more.",
        ),
    ] = None

    def emit(self, shown: "RenderableType", result: Any, title: str) -> None:
        """Print the result or write it; see `ftforce.cli.output.emit`."""
        warnings = getattr(result, "warnings", ())
        emit(shown, result, **vars(self), title=title, warnings=warnings)


class PlotOutputs(Outputs):
    """Where the result and its plot go."""

    plot: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="File for a plot (.png .pdf .svg); repeat it for more. Needs the extra plot.",
        ),
    ] = None


class HistoryOutputs(PlotOutputs):
    """Where a history and its plot go."""

    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="File to write: all instants (.csv .npz .parquet .xlsx), a trajectory for ROS 2 "
            "(.mcap), a summary (.json .tex .md), or the tables (.txt .svg .html); repeat it "
            "for more.",
        ),
    ] = None


class PostureOutputs(PlotOutputs):
    """Where a posture and its plot go."""

    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="File to write: the postures as named ones (.srdf), all of it (.json), the fault "
            "sets (.csv .xlsx .tex .md), or the tables (.txt .svg .html); repeat it for more.",
        ),
    ] = None


class ReachOutputs(PlotOutputs):
    """Where a failure-tolerant workspace, its limits and its plot go."""

    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="File to write: the limits before the fault (.toml, .yaml for MoveIt), all of it "
            "(.json), the cells (.csv .xlsx .tex .md), or the tables (.txt .svg .html); repeat it "
            "for more.",
        ),
    ] = None


class PlanOutputs(PlotOutputs):
    """Where a planned motion and its plot go."""

    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="File to write: the motion, for simulate and timeline (.csv .xlsx) or ROS 2 "
            "(.mcap), all of it (.json), or the tables (.txt .svg .html .tex .md); repeat it "
            "for more.",
        ),
    ] = None


OpenOption = Annotated[
    bool,
    typer.Option("--open", help="Show it in the browser, until Ctrl-C. Needs the extra view."),
]

ExportOption = Annotated[
    Path | None,
    typer.Option(metavar="SCENE.html", help="Write the page to one file and exit."),
]

MaximizeOption = Annotated[
    str,
    typer.Option(
        metavar="MEASURE",
        help="What the worst fault is to leave most of: margin, rho, capability or payload; or "
        "jump, the least force jump.",
    ),
]

_Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]


def guarded(command: Callable[..., None]) -> Callable[..., None]:
    """Report errors as one line on stderr and an exit status, and add the option ``--debug``."""

    @functools.wraps(command)
    def run(debug: bool = False, **given: Any) -> None:
        try:
            check_files(given)
            if "form" in given:
                check_outputs(command.__name__, **given)
            command(**_grouped(command, dict(given)))
        except BrokenPipeError:  # the reader, such as `head`, has closed the pipe
            silence()
        except KeyboardInterrupt:
            typer.echo("interrupted; nothing was written", err=True)
            raise typer.Exit(130) from None
        except (typer.Exit, typer.Abort, typer.BadParameter):
            raise
        except Exception as error:  # never show a traceback, even for internal errors
            if debug:
                raise
            typer.echo(f"error: {printable(_reason(error))}", err=True)
            raise typer.Exit(2 if _is_no_choice(command, given, error) else 1) from None

    parameters = [
        *_expanded(command),
        inspect.Parameter("debug", _KEYWORD, default=False, annotation=_Debug),
    ]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def _groups(command: Callable[..., None]) -> dict[str, type[Group]]:
    """Return the parameters of a command that are groups of options."""
    found = inspect.signature(command).parameters.items()
    return {
        name: parameter.annotation
        for name, parameter in found
        if isinstance(parameter.annotation, type) and issubclass(parameter.annotation, Group)
    }


def _expanded(command: Callable[..., None]) -> Iterator[inspect.Parameter]:
    """Yield the parameters of a command: its own, then the options of each group."""
    groups = _groups(command)
    for name, parameter in inspect.signature(command).parameters.items():
        if name not in groups:
            yield parameter.replace(kind=_KEYWORD)
    for group in groups.values():
        yield from group.options()


def _grouped(command: Callable[..., None], given: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of a command, its options collected in groups."""
    collected = {
        name: group(**{option.name: given.pop(option.name) for option in group.options()})
        for name, group in _groups(command).items()
    }
    return given | collected


def _is_no_choice(command: Callable[..., None], given: dict[str, Any], error: Exception) -> bool:
    """Return whether an error is about a word of an option that takes those of its metavar."""
    if not isinstance(error, UnknownNameError):
        return False
    return any(
        str(error.name) in str(given.get(parameter.name)).split(",")
        and re.split("[|,]", str(option.metavar))[0] in error.available
        for parameter in _expanded(command)
        for option in getattr(parameter.annotation, "__metadata__", ())
    )


def _reason(error: Exception) -> str:
    if isinstance(error, FtforceError):
        return str(error)
    if isinstance(error, MemoryError):
        return out_of_memory(error)
    return f"internal error in ftforce, please report it ({error!r}); --debug shows the traceback"


def numbers(text: str | None, option: str) -> list[float] | None:
    """Parse numbers separated by commas or blanks, with the strict number format of URDFs.

    Raises
    ------
    BadParameter
        The list is empty, or an item is not a finite number.
    """
    if text is None:
        return None
    from ftforce.io.text import read_numbers

    wanted = f"{option} needs numbers separated by commas, e.g. 1,2.5,-3"
    if not text.strip(", "):
        raise typer.BadParameter(f"{wanted}; got none")
    parts = [part.split() for part in text.split(",")]
    if not all(parts):
        raise typer.BadParameter(f"{wanted}; nothing stands beside a comma in {text!r}")
    try:
        return [read_numbers(word, 1, math.inf)[0] for part in parts for word in part]
    except ValueError as problem:
        raise typer.BadParameter(f"{wanted}; {problem}") from None


def items(text: str, option: str) -> list[str]:
    """Split a list of joints at its commas.

    Raises
    ------
    BadParameter
        An item is empty.
    """
    from ftforce.io.text import split_items

    try:
        return split_items(text)
    except InputError as problem:
        raise typer.BadParameter(f"{option}: {problem}") from None


def merged(*groups: Group) -> dict[str, Any]:
    """Return the arguments of several groups."""
    return {name: value for group in groups for name, value in group.arguments().items()}


def given_options(context: typer.Context) -> dict[str, str]:
    """Return the options given on the command line by parameter, spelled as typed there.

    Parameters
    ----------
    context :
        Context of the running command.
    """
    named = {}
    for parameter in context.command.params:
        name = parameter.name or ""
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            is_argument = parameter.param_type_name == "argument"
            named[name] = name.upper() if is_argument else parameter.opts[0]
    return named
