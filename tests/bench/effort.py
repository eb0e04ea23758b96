"""How much is measured: all of it; or, with FTFORCE_BENCH=quick, enough to see that it can be."""

import os

QUICK = os.environ.get("FTFORCE_BENCH") == "quick"


def rounds(many: int) -> int:
    """Return how often something is measured that should be measured ``many`` times."""
    return 1 if QUICK else many
