"""The studies of the designs: predicted errors against 200 estimates each, and designs against the pilots' rules.

Run with ``make design-study``; the tables go to results/design/.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import results, sized

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "design"))

from design_problems import RUNS, write_tables

if __name__ == "__main__":
    for path in write_tables(results("design"), sized(RUNS, 3)):
        print(path)
        print(path.read_text(encoding="utf-8"))
