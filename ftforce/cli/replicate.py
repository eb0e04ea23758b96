"""``ftforce replicate``: replication of the paper's numbers."""

import typer

from ftforce.cli.options import Outputs


def replicate(outputs: Outputs) -> None:
    """Recompute the paper's J and Tables 2-5 and compare each number; exit 1 if any differs.

    Differences explained by an erratum of the paper are shown and do not count.
    """
    from ftforce.analysis.paper import replicate as compute
    from ftforce.show.tables.replication import replication_view

    result = compute()
    outputs.emit(replication_view(result), result, "ftforce replicate")
    if not result.is_successful:
        raise typer.Exit(1)
