"""``ftforce warmup``: compile all kernels ahead."""

import typer


def warmup() -> None:
    """Compile the kernels of sweeps and of the control loop ahead, e.g. in a container's build.

    Without it, each kind of question compiles its own when it first has many postures.
    NUMBA_CACHE_DIR names the folder that keeps them, by default beside the installation.
    """
    from ftforce.batch.warmup import warmup as compile_all

    def report(name: str, seconds: float) -> None:
        typer.echo(f"{name}: {seconds:.1f} s")

    compile_all(report=report)
