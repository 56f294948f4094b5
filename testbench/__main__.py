"""Where the command line begins: ``testbench`` and ``python -m testbench``.

It imports nothing before it can answer an interrupt, because the import of the commands takes a while.
"""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line; an interrupt before it listens for one, or when it no longer does, is one line, too."""
    try:
        try:
            from testbench.cli import main as run

            run()
        finally:  # a signal that comes while Python ends would be said by a traceback
            from testbench.core.interrupts import leave_to_the_system

            leave_to_the_system()
    except KeyboardInterrupt:
        print("interrupted; no result is left half written", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
