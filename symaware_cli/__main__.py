"""``python -m symaware_cli``."""

from symaware_cli.cli import main

if __name__ == "__main__":
    main()
