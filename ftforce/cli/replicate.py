"""``ftforce replicate``: replication of the paper's numbers."""

import typer

from ftforce.cli.options import FormatOption, Output
from ftforce.cli.output import emit


def replicate(form: FormatOption = None, output: Output = None) -> None:
    """Compute the paper's J and Tables 2-5 beside the printed numbers; exit 1 if any differs.

    Differences that an erratum of the paper explains are shown and do not count.
    """
    from ftforce.analysis.paper import replicate as compute
    from ftforce.show.tables.replication import replication_view

    result = compute()
    emit(
        replication_view(result),
        result,
        form=form,
        output=output,
        title="ftforce replicate",
    )
    if not result.is_successful:
        raise typer.Exit(1)
