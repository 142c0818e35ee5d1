"""``python -m dicflow`` is the command line."""

from dicflow.cli import main

main()
