"""The studies of the designs: predicted errors against 200 estimates each, and designs against the pilots' rules.

Run with ``make design-study``; the tables go to results/design/.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "design"))

from design_problems import write_tables  # noqa: E402

if __name__ == "__main__":
    for path in write_tables(ROOT / "results" / "design"):
        print(path.relative_to(ROOT))
        print(path.read_text(encoding="utf-8"))
