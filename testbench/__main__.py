"""Where the command line begins: ``testbench`` and ``python -m testbench``.

It imports nothing before it can answer an interrupt, because the import of the commands takes a while.
"""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line; an interrupt while it is imported ends it in one line, too."""
    try:
        from testbench.cli import main as run
    except KeyboardInterrupt:
        print("interrupted; nothing was written", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
