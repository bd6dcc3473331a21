"""``python -m ambkit``."""

from ambkit.cli.main import main

main()
