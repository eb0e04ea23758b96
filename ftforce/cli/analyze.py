"""``ftforce analyze``: one posture, one fault set."""

from typing import Annotated

import typer

from ftforce.cli.common import (
    AxesOption,
    Base,
    Degrees,
    Force,
    FormatOption,
    Length,
    Output,
    Positions,
    PostureName,
    RobotArgument,
    Rtol,
    TaskOption,
    Tip,
    Torque,
    Wary,
    emit,
    load,
    numbers,
    refuse_force_and_torque,
)


def analyze(
    robot: RobotArgument,
    locked: Annotated[
        list[str] | None,
        typer.Option(metavar="2,4", help="Locked joints: numbers from 1 or names, by commas."),
    ] = None,
    q: Positions = None,
    posture: PostureName = None,
    deg: Degrees = False,
    force: Force = None,
    torque: Torque = None,
    velocity: Annotated[
        str | None,
        typer.Option(metavar="V1,V2,…", help="Joint velocities before the fault, rad/s or m/s."),
    ] = None,
    task: TaskOption = "force",
    length: Length = None,
    axes: AxesOption = "tool",
    base: Base = None,
    tip: Tip = None,
    rtol: Rtol = 1e-6,
    wary: Wary = 1e-2,
    form: FormatOption = None,
    output: Output = None,
) -> None:
    """Say what locked joints do to the force at the tool, and which torques to command now.

    Without --force or --torque: the same for every unit force, and which directions are lost.
    """
    refuse_force_and_torque(force, torque)
    from ftforce import analysis
    from ftforce.posture import choose_posture
    from ftforce.show.analysis import analysis_view

    arm = load(robot, tip, base, posture)
    place = choose_posture(arm, numbers(q, "--q"), posture, degrees=deg)
    result = analysis.analyze(
        arm,
        place,
        locked=",".join(locked or ()),
        force=numbers(force, "--force"),
        torque=numbers(torque, "--torque"),
        velocity=numbers(velocity, "--velocity"),
        task=task,
        length=length,
        axes=axes,  # type: ignore[arg-type] # checked there, with a message that lists them
        rtol=rtol,
        wary=wary,
    )
    emit(
        analysis_view(result, degrees=deg),
        result,
        form=form,
        output=output,
        title=f"ftforce analyze {arm.name}",
        warnings=result.warnings,
    )
