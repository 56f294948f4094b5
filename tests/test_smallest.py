"""What a study writes into a folder of results is listed in its manifest."""

import os
import subprocess
import sys

import pytest
from smallest import ROOT

from testbench.questions.results.ask import verify_results

# The file's own time says nothing: the kernel's lies up to a tick before any clock that the study reads.
STUDY = """
import os
from smallest import results
made = results("a", "made.csv")
made.write_text("1")
os.utime(made, (0, 0))
(results("a") / "failed.csv").write_text("2") if {fails} else None
1 // (not {fails})
"""


def study(folder, fails):
    environment = os.environ | {"TESTBENCH_SMALLEST": str(folder), "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}
    done = subprocess.run([sys.executable, "-c", STUDY.format(fails=fails)], env=environment, check=False)
    return done.returncode


def test_a_study_lists_what_it_wrote_and_one_that_fails_does_not(tmp_path):
    folder = tmp_path / "results" / "a"
    folder.mkdir(parents=True)
    (folder / "before.csv").write_text("0")
    assert study(tmp_path, False) == 0
    assert study(tmp_path, True) == 1
    found = verify_results(folder)
    assert (found.whole, set(found.manifest.files)) == (True, {"made.csv"})
    assert found.extra == ("before.csv", "failed.csv")
    (folder / "made.csv").write_text("3")
    assert verify_results(folder).changed == ("made.csv",)


FOLDERS = sorted({p.parent.parent for p in (ROOT / "results").rglob(".testbench/manifest.json")})


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_what_git_keeps_is_what_was_written(folder):
    assert verify_results(folder).whole


def test_no_folder_that_git_keeps_is_without_a_manifest():
    assert len(FOLDERS) > 8
