"""``python -m dicflow`` is the command line."""

from dicflow.cli import main

if __name__ == "__main__":  # worker processes import this module again
    main()
