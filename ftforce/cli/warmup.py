"""``ftforce warmup``: compile all kernels ahead."""

from typing import Annotated

import typer


def warmup(
    kernels: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[force|wrench|free|remapper]…",
            help="For sweeps of tasks of three rows, of other tasks, of free-swinging joints, or "
            "for control loops; all by default.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Compile the kernels of sweeps and of the control loop ahead, e.g. in a container's build.

    Without it, each kind of question compiles its own when it first has many postures.
    NUMBA_CACHE_DIR names the folder that keeps them, by default beside the installation.
    """
    from ftforce.batch.warmup import KERNELS
    from ftforce.batch.warmup import warmup as compile_all

    def report(name: str, seconds: float) -> None:
        typer.echo(f"{name}: {seconds:.1f} s")

    compile_all(kernels or KERNELS, report)
