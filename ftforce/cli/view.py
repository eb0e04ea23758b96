"""``ftforce view``: the interactive browser view."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ftforce.cli.options import (
    Acceleration,
    AxesOption,
    Base,
    Degrees,
    Force,
    Free,
    Gravity,
    InverseOption,
    Length,
    LimitsOption,
    Locked,
    PayloadOption,
    Positions,
    PostureName,
    RobotArgument,
    Rtol,
    TaskOption,
    Tip,
    Torque,
    Velocity,
    Wary,
    Weak,
    given_options,
    load,
    numbers,
    refuse_force_and_torque,
)
from ftforce.cli.printing import say
from ftforce.errors import InputError, OutputError, printable

if TYPE_CHECKING:
    from ftforce.robot.robot import Robot
    from ftforce.view.model.state import Origin
    from ftforce.view.session import Session


_LOAD = {"force", "torque", "velocity", "acceleration", "gravity"}
_OF_A_SWEEP = _LOAD | {"limits", "inverse", "task", "length", "axes", "rtol", "wary"}


def view(
    context: typer.Context,
    robot: RobotArgument,
    locked: Locked = None,
    free: Free = None,
    weak: Weak = None,
    q: Positions = None,
    posture: PostureName = None,
    deg: Degrees = False,
    force: Force = None,
    torque: Torque = None,
    velocity: Velocity = None,
    acceleration: Acceleration = None,
    gravity: Gravity = None,
    payload: PayloadOption = None,
    limits: LimitsOption = None,
    inverse: InverseOption = "euclidean",
    task: TaskOption = "force",
    length: Length = None,
    axes: AxesOption = "tool",
    base: Base = None,
    tip: Tip = None,
    rtol: Rtol = 1e-6,
    wary: Wary = 1e-2,
    history: Annotated[
        Path | None,
        typer.Option(metavar="RUN.npz", help="Play what `ftforce simulate` wrote (.npz .csv …)."),
    ] = None,
    sweep: Annotated[
        Path | None,
        typer.Option(metavar="SWEEP.zarr", help="Show the points of a stored `ftforce sweep`."),
    ] = None,
    at: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Time of the history to begin with; 0 if not given."),
    ] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address, open no browser.")
    ] = False,
    host: Annotated[
        str,
        typer.Option(
            help="Address to listen on; any but loopback lets other machines move the arm."
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int | None,
        typer.Option(min=1, max=65535, help="Port to listen on; without it the first free one."),
    ] = None,
    export: Annotated[
        Path | None,
        typer.Option(metavar="SCENE.html", help="Write the page into one file, and end."),
    ] = None,
    screenshot: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Write the scene as a picture, and end."),
    ] = None,
) -> None:
    """See and touch the arm in the browser: drag the force, move joints, fail them with a click.

    Without --force or --torque: 20 N along each axis to begin with.
    """
    refuse_force_and_torque(force, torque)
    if history is not None and sweep is not None:
        raise typer.BadParameter("give either --history or --sweep, not both")
    if history is not None or sweep is not None:
        _refuse_question(context)
    if at is not None and history is None:
        raise typer.BadParameter("--at is a time of a --history; give one")
    _check_outputs(export, screenshot)
    from ftforce.robot.posture import choose_posture
    from ftforce.view.model.state import Origin, initial_state
    from ftforce.view.session import Session

    arm = load(robot, tip, base, posture)
    place = numbers(q, "--q")
    start = initial_state(
        arm,
        None if place is None else choose_posture(arm, place, posture, degrees=deg),
        origin=_doubted(arm, Origin(robot, base, tip, posture)),
        locked=",".join(locked or ()),
        free=",".join(free or ()),
        weak=",".join(weak or ()),
        force=numbers(force, "--force"),
        torque=numbers(torque, "--torque"),
        velocity=numbers(velocity, "--velocity"),
        acceleration=numbers(acceleration, "--acceleration"),
        gravity=numbers(gravity, "--gravity"),
        payload=payload,
        limits=limits,
        inverse=inverse,  # type: ignore[arg-type] # checked there, with a message that lists them
        task=task,
        length=length,
        axes=axes,  # type: ignore[arg-type] # likewise
        rtol=rtol,
        wary=wary,
    )
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
        if export is not None or screenshot is not None:
            _write(session, export, screenshot)
            return
        if session.problem:  # same error as `analyze`
            raise InputError(session.problem)
        session.run(lambda: _announce(arm.name, session.address, no_browser))


def _announce(name: str, address: str, no_browser: bool) -> None:
    say(f"{name}: {address} (Ctrl-C ends it)")
    if not no_browser:
        _open(address)


def _refuse_question(context: typer.Context) -> None:
    """Reject options of the question that a history or sweep determines itself."""
    of, own = "sweep", _OF_A_SWEEP
    if context.params["history"] is not None:
        of, own = "history", _OF_A_SWEEP | {"q", "payload"}
    if named := given_options(context, own):
        raise InputError(f"a {of} has a question of its own; leave out {', '.join(named)}")


def _check_outputs(export: Path | None, screenshot: Path | None) -> None:
    """Reject files that could not be written, before the server is started."""
    for path, endings in ((export, (".html", ".htm")), (screenshot, (".png",))):
        if path is None:
            continue
        if path.suffix.lower() not in endings:
            raise InputError(f"{printable(path)}: the name must end in {' or '.join(endings)}")
        if not path.parent.is_dir():
            raise OutputError(path, "cannot be written (there is no such folder)")


def _doubted(arm: "Robot", origin: "Origin") -> "Origin":
    """Note if ``analyze --q`` would use different positions for the joints outside the chain."""
    if origin.posture is None or not arm.held:
        return origin
    if dict(load(origin.robot, origin.tip, origin.base, None).held) == dict(arm.held):
        return origin
    note = (
        f"The page holds the joints outside the chain as posture {origin.posture!r} has them; "
        "with --q the command holds them as the default posture has them."
    )
    return origin._replace(note=note)


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
