"""``ftforce robots``: list of the known robots."""

from ftforce.cli.options import Outputs


def robots(outputs: Outputs) -> None:
    """List the known robots with their number of joints, tip and postures."""
    from ftforce.robot.known_robots import known_robots
    from ftforce.robot.load import load_robot
    from ftforce.show.tables.robot import robots_view

    arms = [(known, load_robot(name)) for name, known in known_robots().items()]
    outputs.emit(robots_view(arms), [arm for _, arm in arms], "ftforce robots")
