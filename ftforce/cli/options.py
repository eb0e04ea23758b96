"""Common options, parsing of vectors, and handling of errors.

Exit status: 0 success, 1 invalid input, 2 invalid command line, 130 interrupted.
"""

import functools
import inspect
import math
from collections.abc import Callable, Container
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ftforce.cli.output import Format, check_outputs
from ftforce.cli.printing import silence
from ftforce.errors import FtforceError, InputError

if TYPE_CHECKING:
    from ftforce.robot.robot import Robot

RobotArgument = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT", help="A URDF file, or a known name such as panda (see `ftforce robots`)."
    ),
]
Tip = Annotated[str | None, typer.Option(help="Tip link; without it the robot's own.")]
Base = Annotated[
    str | None, typer.Option(help="Base link; without it the robot's own, or the root.")
]
Positions = Annotated[
    str | None,
    typer.Option("--q", metavar="Q1,Q2,…", help="Joint positions along the chain, rad or m."),
]
PostureName = Annotated[
    str | None,
    typer.Option("--posture", help="A named posture; also mid-range, zero, sample."),
]
Degrees = Annotated[
    bool, typer.Option("--deg", help="--q is in degrees (metres stay metres); shown so too.")
]
Force = Annotated[
    str | None,
    typer.Option(metavar="FX,FY,FZ", help="Force the tool exerts on its environment, N (and N·m)."),
]
Torque = Annotated[
    str | None,
    typer.Option(
        metavar="T1,T2,…",
        help="Instead of a force: motor torques meant for it, N·m, without weight and motion.",
    ),
]
Locked = Annotated[
    list[str] | None,
    typer.Option(metavar="2,4", help="Locked joints: numbers from 1 or names, by commas."),
]
Free = Annotated[
    list[str] | None,
    typer.Option(metavar="4", help="Free-swinging joints: neither motor nor brake gives torque."),
]
Weak = Annotated[
    list[str] | None,
    typer.Option(metavar="3:0.5", help="Weak joints, with the share of their torque that is left."),
]
Velocity = Annotated[
    str | None,
    typer.Option(metavar="V1,V2,…", help="Joint velocities before the fault, rad/s or m/s."),
]
Acceleration = Annotated[
    str | None,
    typer.Option(metavar="A1,A2,…", help="Joint accelerations before the fault, rad/s² or m/s²."),
]
Gravity = Annotated[
    str | None,
    typer.Option(
        metavar="GX,GY,GZ",
        help="Gravity in the root's axes, m/s²; without it the model's. 0,0,0 in space.",
    ),
]
PayloadOption = Annotated[
    str | None,
    typer.Option(
        "--payload",
        metavar="KG[@X,Y,Z]",
        help="Mass at the tip, kg, and its place in tool axes, m.",
    ),
]
_LIMITS_HELP = "Torque limits that count: the URDF's or a TOML or CSV file's (joint,effort,brake)."
LimitsOption = Annotated[
    str | None,
    typer.Option(
        "--limits",
        metavar="urdf|FILE|none",
        help=_LIMITS_HELP,
        show_default="none; urdf where they are needed",
    ),
]
LimitsOfCapability = Annotated[
    str | None,
    typer.Option("--limits", metavar="urdf|FILE|none", help=_LIMITS_HELP),
]
InverseOption = Annotated[
    str,
    typer.Option(
        "--inverse",
        metavar="euclidean|dynamic",
        help="How --torque is split into force and self-motion.",
    ),
]
Direction = Annotated[
    str | None,
    typer.Option(metavar="X,Y,Z", help="A direction of force, in the task's axes."),
]
TaskOption = Annotated[
    str, typer.Option(help="force, moment, wrench, or components such as fx,fz,my.")
]
Length = Annotated[
    float | None,
    typer.Option(help="Characteristic length in m that weighs moments; 1 if not given."),
]
AxesOption = Annotated[
    str, typer.Option(help="tool: axes of the tip frame; world: axes of the root, at the tip.")
]
Rtol = Annotated[
    float, typer.Option(help="Singular values up to rtol * sigma_max(J) count as lost.")
]
Wary = Annotated[
    float, typer.Option(help="Borderline if a tolerance up to this changes the verdict.")
]
FormatOption = Annotated[
    Format | None, typer.Option("--format", help="table, json or csv; from --output's ending.")
]
Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        help="Write to this file (.json .csv .txt .svg .html), whole or not at all.",
    ),
]
HistoryOutput = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        help="Write to this file, whole or not at all: every instant (.csv .npz .parquet), a "
        "summary (.json), the tables (.txt .svg .html).",
    ),
]
PlotOption = Annotated[
    Path | None,
    typer.Option(
        "--plot",
        metavar="FILE",
        help="Draw the result into this file (.png .pdf .svg); needs the extra plot.",
    ),
]
_Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]


def guarded(command: Callable[..., None]) -> Callable[..., None]:
    """Report errors as one line on stderr and an exit status, and add the option ``--debug``."""

    @functools.wraps(command)
    def run(*args: Any, debug: bool = False, **kwargs: Any) -> None:
        try:
            if "form" in kwargs:
                check_outputs(command.__name__, **kwargs)
            command(*args, **kwargs)
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
            typer.echo(f"error: {_reason(error)}", err=True)
            raise typer.Exit(1) from None

    signature = inspect.signature(command)
    option = inspect.Parameter("debug", inspect.Parameter.KEYWORD_ONLY, default=False)
    parameters = [*signature.parameters.values(), option.replace(annotation=_Debug)]
    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {**command.__annotations__, "debug": _Debug}
    return run


def _reason(error: Exception) -> str:
    if isinstance(error, FtforceError):
        return str(error)
    return f"a mistake in ftforce, please report it ({error!r}); --debug shows where it happened"


def numbers(text: str | None, option: str) -> list[float] | None:
    """Parse numbers separated by commas or blanks, with the strict number format of URDFs.

    Raises
    ------
    InputError
        The list is empty, or an item is not a finite number.
    """
    if text is None:
        return None
    from ftforce.io.text import read_numbers

    wanted = f"{option} needs numbers separated by commas, e.g. 1,2.5,-3"
    words = text.replace(",", " ").split()
    if not words:
        raise InputError(f"{wanted}; got none")
    try:
        return [read_numbers(word, 1, math.inf)[0] for word in words]
    except ValueError as problem:
        raise InputError(f"{wanted}; {problem}") from None


def refuse_force_and_torque(force: str | None, torque: str | None) -> None:
    """Reject --force together with --torque."""
    if force is not None and torque is not None:
        raise typer.BadParameter("give either --force or --torque, not both")


def load(robot: str, tip: str | None, base: str | None, posture: str | None) -> "Robot":
    """Load the robot specified on the command line."""
    from ftforce.robot.load import load_robot

    return load_robot(robot, tip=tip, base=base, posture=posture)


def given_options(context: typer.Context, among: Container[str]) -> list[str]:
    """Return the options given on the command line, spelled as typed there.

    Parameters
    ----------
    context :
        Context of the running command.
    among :
        Names of the parameters to consider.
    """
    named = []
    for parameter in context.command.params:
        name = parameter.name or ""
        source = context.get_parameter_source(name)
        if name in among and source is not None and source.name == "COMMANDLINE":
            is_argument = parameter.param_type_name == "argument"
            named.append(name.upper() if is_argument else parameter.opts[0])
    return named
