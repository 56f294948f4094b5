"""One process at a time writes into a folder of results."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest

from testbench.core.claim import claim
from testbench.core.errors import BusyError
from testbench.page.write import check_folder, record_keeper

HOLD = (
    "import sys; from pathlib import Path; from testbench.core.claim import claim; claim(Path(sys.argv[1])); "
    "print('held', flush=True); input()"
)


def test_the_second_process_is_refused_until_the_first_ends(tmp_path):
    place = re.escape(str(tmp_path))
    words = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout.readline() == "held\n"
        for claims in (claim, check_folder, record_keeper):
            with pytest.raises(BusyError, match=rf"process.* is writing to '{place}'") as error:
                claims(tmp_path)
            assert error.value.exit_status == 3
        first.kill()
    claim(tmp_path)
    assert os.listdir(tmp_path) == []


def test_a_process_may_claim_its_folder_again_and_many_others(tmp_path):
    for k in (0, 0, *range(100)):
        claim(tmp_path / str(k))
    assert len(list(tmp_path.iterdir())) == 100
