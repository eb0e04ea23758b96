"""``ftforce view``: the interactive browser view."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ftforce.cli.options import (
    ChainOptions,
    DriveOptions,
    ExportOption,
    FaultOptions,
    FrictionOption,
    LimitsOption,
    LoadOptions,
    MotionOptions,
    PostureOptions,
    RobotArgument,
    TaskOptions,
    Tolerances,
    WeightOptions,
    given_options,
    merged,
)
from ftforce.cli.printing import say
from ftforce.errors import InputError, OutputError, printable

if TYPE_CHECKING:
    from ftforce.robot.robot import Robot
    from ftforce.view.session import Session


_LOAD = {"force", "torque", "velocity", "acceleration", "gravity", "payload"}
_OF_A_SWEEP = _LOAD | {
    "limits",
    "friction",
    "joint_friction",
    "armature",
    "inverse",
    "task",
    "length",
    "joint_length",
    "axes",
    "rtol",
    "wary",
}
_OF_A_HISTORY = _OF_A_SWEEP | {"q"}


def view(
    context: typer.Context,
    robot: RobotArgument,
    fault_options: FaultOptions,
    posture_options: PostureOptions,
    load: LoadOptions,
    motion: MotionOptions,
    weight: WeightOptions,
    limits: LimitsOption,
    friction: FrictionOption,
    drives: DriveOptions,
    task_options: TaskOptions,
    chain: ChainOptions,
    tolerances: Tolerances,
    history: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN.npz", help="Play a history stored by `ftforce simulate` (.npz .csv …)."
        ),
    ] = None,
    sweep: Annotated[
        Path | None,
        typer.Option(metavar="SWEEP.zarr", help="Show the postures of a stored `ftforce sweep`."),
    ] = None,
    at: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Time at which the history begins.", show_default="0"),
    ] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address without opening a browser.")
    ] = False,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Address to listen on; with any but loopback, other machines that know the token "
            "can change the page.",
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=65535,
            metavar="PORT",
            help="Port to listen on.",
            show_default="the first that is free",
        ),
    ] = None,
    export: ExportOption = None,
    screenshot: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Write the scene as a picture and exit."),
    ] = None,
) -> None:
    """View the arm in the browser: drag the force, move joints, fail them with a click.

    Without --force or --torque: 20 N along each axis to begin with.
    """
    if history is not None and sweep is not None:
        raise typer.BadParameter("give either --history or --sweep, not both")
    if history is not None or sweep is not None:
        _refuse_question(context, is_history=history is not None)
    if at is not None and history is None:
        raise typer.BadParameter("--at requires --history")
    check_pages(export, screenshot)
    from ftforce.analysis.question import Question
    from ftforce.robot.formats.xacro import XacroOptions
    from ftforce.view.model.state import Origin, initial_state
    from ftforce.view.session import Session

    posture = posture_options.posture
    arm = chain.load(robot, posture)
    question = Question.parse(
        arm,
        faults=fault_options.of(arm),
        **merged(load, motion, weight, limits, friction, drives, task_options, tolerances),
    ).placed(posture_options.of(arm))
    origin = Origin(
        robot,
        chain.base,
        chain.tip,
        posture,
        _note(arm, robot, chain, posture),
        XacroOptions.of(chain.arguments()["args"], chain.package_path),
        chain.srdf,
    )
    start = initial_state(question, origin=origin, are_limits_given=limits.limits is not None)
    mode: Any = None
    if history is not None:
        from ftforce.view.playback import playback

        mode = playback(arm, start, history, at or 0.0)
    if sweep is not None:
        from ftforce.view.survey import survey

        mode = survey(arm, start, sweep)
    with Session(arm, start, host=host, port=port, mode=mode) as session:
        if session.warning:
            typer.echo(f"warning: {session.warning}", err=True)
        show(session, export=export, screenshot=screenshot, no_browser=no_browser)


def show(
    session: "Session",
    *,
    export: Path | None = None,
    screenshot: Path | None = None,
    no_browser: bool = False,
) -> None:
    """Write the page or its picture, or else keep it open in the browser until Ctrl-C.

    Parameters
    ----------
    session :
        The page.
    export, screenshot :
        Files for the page and its picture.
    no_browser :
        Whether the address is only printed.

    Raises
    ------
    InputError
        The question has no answer.
    """
    if export is not None or screenshot is not None:
        _write(session, export, screenshot)
        return
    if session.problem:  # same error as `analyze`
        raise InputError(session.problem)
    session.run(lambda: _announce(session, no_browser))


def _announce(session: "Session", no_browser: bool) -> None:
    say(f"{session.robot.name}: {session.address} (press Ctrl-C to stop)")
    if not no_browser:
        _open(session.address_for_browser())


def _refuse_question(context: typer.Context, *, is_history: bool) -> None:
    """Reject options of the question that a history or sweep determines itself."""
    of, own = ("history", _OF_A_HISTORY) if is_history else ("sweep", _OF_A_SWEEP)
    given = given_options(context)
    if named := [given[name] for name in given if name in own]:
        raise typer.BadParameter(f"a {of} determines these itself; leave out {', '.join(named)}")


def check_pages(export: Path | None, screenshot: Path | None = None) -> None:
    """Reject files that could not be written, before the server is started.

    Parameters
    ----------
    export, screenshot :
        As in `show`.

    Raises
    ------
    BadParameter
        A name has another ending.
    OutputError
        The folder does not exist.
    """
    from ftforce.io.text import is_folder

    for path, endings in ((export, (".html", ".htm")), (screenshot, (".png",))):
        if path is None:
            continue
        if path.suffix.lower() not in endings:
            raise typer.BadParameter(
                f"{printable(path)}: the name must end in {' or '.join(endings)}"
            )
        if not is_folder(path.parent):
            raise OutputError(path, "cannot be written (no such folder)")


def _note(arm: "Robot", robot: str, chain: ChainOptions, posture: str | None) -> str:
    """Return a note if ``analyze --q`` would hold the joints outside the chain elsewhere."""
    if posture is None or not arm.held:
        return ""
    if dict(chain.load(robot).held) == dict(arm.held):
        return ""
    return (
        f"The page holds the joints outside the chain as in posture {posture!r}; with --q the "
        "command holds them as in the default posture."
    )


def _write(session: "Session", export: Path | None, screenshot: Path | None) -> None:
    from ftforce.io.text import write_whole

    session.load_geometry()
    session.settle()
    if session.problem:
        raise InputError(session.problem)
    if export is not None:
        say(f"wrote {printable(write_whole(export, session.page()))}")
    if screenshot is not None:
        say(f"wrote {printable(write_whole(screenshot, session.png()))}")


def _open(address: str) -> None:
    """Open the browser; if there is none, the address has already been printed."""
    import webbrowser

    try:
        webbrowser.open(address)
    except webbrowser.Error:
        return
