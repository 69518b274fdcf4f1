"""The `isorod` command, also as ``python -m isorod``."""

import gc
import sys

from isorod.command import ending


def main() -> int:
    """Run the command line; return the exit code."""
    return ending.run("isorod", _command)


def _command() -> int:
    # Nearly all that is made while modules are loaded stays: to look for garbage less often saves 0.07 of 1.1 s.
    gc.set_threshold(20_000)
    # Loaded here, where Ctrl-C is one line already.
    from isorod.command import cli

    return cli.command(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
