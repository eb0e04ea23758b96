"""``ftforce posture``: the posture that keeps the most after the worst fault."""

from typing import TYPE_CHECKING, Annotated

import typer

from ftforce.cli.options import (
    ChainOptions,
    ExportOption,
    ForceOptions,
    FrictionOption,
    LimitsOption,
    MaximizeOption,
    OpenOption,
    PostureOptions,
    PostureOutputs,
    RobotArgument,
    SeedOption,
    SetOptions,
    TaskOptions,
    Tolerances,
    TopOption,
    WeightOptions,
    merged,
    numbers,
)
from ftforce.cli.progress import progress_bar

if TYPE_CHECKING:
    from ftforce.robot.posture import Posture
    from ftforce.robot.robot import Robot


def posture(
    robot: RobotArgument,
    sets: SetOptions,
    forces: ForceOptions,
    posture_options: PostureOptions,
    weight: WeightOptions,
    limits: LimitsOption,
    friction: FrictionOption,
    task_options: TaskOptions,
    chain: ChainOptions,
    tolerances: Tolerances,
    outputs: PostureOutputs,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Position of the tip in root axes, m.",
            show_default="as with --like",
        ),
    ] = None,
    rpy: Annotated[
        str | None,
        typer.Option(
            metavar="R,P,Y",
            help="Roll, pitch and yaw of the tip that are kept, rad (degrees with --deg).",
            show_default="the tip may turn",
        ),
    ] = None,
    like: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|Q1,Q2,…",
            help="Posture whose orientation of the tip is kept.",
            show_default="the tip may turn",
        ),
    ] = None,
    maximize: MaximizeOption = "margin",
    restarts: Annotated[
        int, typer.Option(metavar="N", help="Random postures from which others are searched.")
    ] = 128,
    seed: SeedOption = 0,
    top: TopOption = 40,
    open_page: OpenOption = False,
    export: ExportOption = None,
) -> None:
    """Find the posture that keeps the most after a fault, with the tip at one place.

    The worst set of failed joints counts. --q or --posture is what it is
    compared with; collisions are not checked.
    """
    from ftforce.cli.view import check_pages, show
    from ftforce.planning.posture import best_posture
    from ftforce.show.tables.posture import posture_view

    check_pages(export)
    arm = chain.load(robot, posture_options.posture)
    asked = merged(sets, forces, weight, limits, friction, task_options, tolerances)
    turned = numbers(rpy, "--rpy")
    if turned is not None and posture_options.deg:
        from math import radians

        turned = [radians(angle) for angle in turned]
    model = None if like is None else _posture_like(arm, like, degrees=posture_options.deg)
    with progress_bar("starts") as progress:
        found = best_posture(
            arm, numbers(at, "--at"), rpy=turned, like=model, q=posture_options.of(arm),
            maximize=maximize, restarts=restarts, seed=seed, progress=progress, **asked,
        )  # fmt: skip
    shown = posture_view(found, most=top, degrees=posture_options.deg)
    outputs.emit(shown, found, f"ftforce posture {arm.name}")
    if open_page or export is not None:
        from ftforce.view.planned import open_posture

        with open_posture(found) as session:
            show(session, export=export)


def _posture_like(arm: "Robot", like: str, *, degrees: bool) -> "Posture":
    """Return the posture that --like names, or whose joint positions it gives."""
    from ftforce.robot.posture import choose_posture

    if "," in like or like.strip().lstrip("+-.")[:1].isdecimal():
        return choose_posture(arm, numbers(like, "--like"), degrees=degrees)
    return choose_posture(arm, name=like)
