"""``python -m ftforce``."""

from ftforce.cli import main

main()
