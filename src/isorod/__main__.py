"""The `isorod` command, also as ``python -m isorod``."""

import sys

from isorod.command import ending


def main() -> int:
    """Run the command line; return the exit code."""
    return ending.run("isorod", _command)


def _command() -> int:
    # Loaded here, where Ctrl-C is one line already.
    from isorod.command import cli

    return cli.command(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
