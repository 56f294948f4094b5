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
    try:
        run()
    finally:  # a signal that comes while Python ends would be said by a traceback
        from testbench.core.interrupts import leave_to_the_system

        leave_to_the_system()


if __name__ == "__main__":
    main()
