"""``ftforce replicate``: replication of the paper's numbers."""

from typing import Annotated

import typer

from ftforce.cli.options import ChainOptions, Outputs, PostureOptions, numbers


def replicate(
    chain: ChainOptions,
    posture: PostureOptions,
    outputs: Outputs,
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            metavar="ROBOT",
            help="Compute the same tables for another arm: a file or a known name.",
            show_default="the paper's",
        ),
    ] = None,
    force: Annotated[
        str | None,
        typer.Option(
            metavar="FX,FY,FZ", help="Force at the tip, N, with --robot.", show_default="80,50,10"
        ),
    ] = None,
    velocity: Annotated[
        str | None,
        typer.Option(
            metavar="V1,V2,…",
            help="Joint velocities, rad/s or m/s, with --robot.",
            show_default="the paper's for 5 joints, else 0.1 each",
        ),
    ] = None,
) -> None:
    """Recompute the paper's J and Tables 2-5 and compare each number; exit 1 if any differs.

    Differences explained by an erratum of the paper are shown and do not count.
    """
    from ftforce.analysis.paper import paper_tables
    from ftforce.analysis.paper import replicate as compute
    from ftforce.show.tables.replication import replication_view

    if robot is None:
        if posture.is_given or chain.is_given or force is not None or velocity is not None:
            raise typer.BadParameter(
                "chain, posture, force and velocity of the paper are fixed; give --robot"
            )
        result = compute()
    else:
        arm = chain.load(robot, posture.posture)
        F, v = numbers(force, "--force"), numbers(velocity, "--velocity")
        result = paper_tables(arm, posture.of(arm), force=F, velocity=v)
    outputs.emit(replication_view(result), result, "ftforce replicate")
    if not result.is_successful:
        raise typer.Exit(1)
