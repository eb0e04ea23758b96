"""``ftforce robots``: list of the known robots."""

from ftforce.cli.options import FormatOption, Output, load
from ftforce.cli.output import emit


def robots(form: FormatOption = None, output: Output = None) -> None:
    """List the known robots with their number of joints, tip and postures."""
    from ftforce.robot.known_robots import known_robots
    from ftforce.show.tables.robot import robots_view

    arms = [(known, load(name, None, None, None)) for name, known in known_robots().items()]
    emit(
        robots_view(arms),
        [arm for _, arm in arms],
        form=form,
        output=output,
        title="ftforce robots",
    )
