"""``python -m sealegs``: the same as the command ``sealegs``."""

import sys

from .commands.cli import main

if __name__ == "__main__":
    sys.exit(main())
