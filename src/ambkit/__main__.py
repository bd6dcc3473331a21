"""``python -m ambkit``."""

from ambkit.cli import main

main()
