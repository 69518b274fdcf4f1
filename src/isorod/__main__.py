"""``python -m isorod``: the `isorod` command."""

import sys

from isorod.command.cli import main

sys.exit(main())
