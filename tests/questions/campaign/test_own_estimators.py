"""Users' own estimators in a campaign: on workers, on a cluster, each failure a row, and never another file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from failing_estimators import METHODS, own, write

from testbench.core.door import sha256
from testbench.core.errors import CampaignError
from testbench.questions.campaign.answer import campaign_answer
from testbench.questions.campaign.ask import fly_campaign
from testbench.questions.campaign.flying import Job, fly_batch
from testbench.questions.campaign.load import load_campaign, versions
from testbench.questions.campaign.page import campaign_page
from testbench.questions.campaign.result import read_campaign
from testbench.questions.campaign.store import Store

CAMPAIGN = """
title = "Own"
base = "cells.toml"
runs = {runs}
seed = 2
truth = false
[vary]
"condition.V_m_s" = {{ kind = "normal", mean = 16.0, std = 0.2 }}
"""


def campaign(folder: Path, estimators: str, runs: int = 4, limit_s: float = 20.0):
    folder.mkdir(exist_ok=True)
    write(folder, estimators, limit_s, suites='"eolo_alpha"')
    file = folder / "own.toml"
    file.write_text(CAMPAIGN.format(runs=runs), encoding="utf-8")
    return load_campaign(file)


def rows(folder: Path) -> list[tuple[int, str, str | None]]:
    with Store.read(folder) as store:
        return [(row.run, row.state, row.results) for row in store.rows()]


def test_every_failure_is_a_row_and_the_others_go_on(tmp_path) -> None:
    """A worker flies in a thread, which cannot be ended while it sleeps: the whole run was lost with its worker."""
    loaded = campaign(tmp_path, own("raises", "sleeps", "works"), runs=2, limit_s=2.0)
    ending = fly_campaign(loaded, tmp_path / "s", workers=2)
    assert ending.counts.done == 2
    for _, _, results in rows(tmp_path / "s"):
        found = json.loads(results or "")
        assert set(found["figures"]) == {"eolo_alpha, methods.py:works"}
        assert len(found["failed"]) == 2
        assert "must end within limit_s = 2 s" in found["failed"]["eolo_alpha, methods.py:sleeps"]
    with Store.read(tmp_path / "s") as store:
        result = read_campaign(loaded, store)
    said = " ".join(text for _, text in campaign_answer(result))
    assert "eolo_alpha, methods.py:raises gave no model in 2 of 2 runs" in said
    table = next(t for t in campaign_page(result).tables if t.name == "failed")
    assert [row[1] for row in table.rows] == [2, 2]


def test_what_an_own_estimator_takes_counts_in_the_cost_of_a_run(tmp_path) -> None:
    """It works in another process than the one whose time was counted."""
    loaded = campaign(tmp_path, own("busy"), runs=1)
    fly_campaign(loaded, tmp_path / "s", workers=1)
    with Store.read(tmp_path / "s") as store:
        spent_s, _ = store.seconds()
    assert spent_s > 1.5


@pytest.mark.slow
def test_work_that_never_comes_back_or_ends_its_process_is_a_row_too(tmp_path) -> None:
    loaded = campaign(tmp_path, own("hangs", "in_c", "crashes", "works"), runs=1, limit_s=2.0)
    ending = fly_campaign(loaded, tmp_path / "s", workers=1)
    assert (ending.counts.done, ending.counts.failed) == (1, 0)
    ((_, _, results),) = rows(tmp_path / "s")
    found = json.loads(results or "")
    assert set(found["figures"]) == {"eolo_alpha, methods.py:works"}
    for name in ("hangs", "in_c"):
        assert "must end within limit_s = 2 s" in found["failed"][f"eolo_alpha, methods.py:{name}"]
    assert "its process ended with status" in found["failed"]["eolo_alpha, methods.py:crashes"]


@pytest.mark.slow
def test_a_worker_in_another_folder_runs_the_file_of_the_campaign(tmp_path, cluster) -> None:
    """Its own folder holds another file of that name, which it must not take."""
    loaded = campaign(tmp_path / "mine", own("works"))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "methods.py").write_text(METHODS.replace("order=4", "order=2"), encoding="utf-8")
    _, address = cluster.scheduler(1)
    cluster.worker(address, elsewhere)
    fly_campaign(loaded, tmp_path / "far", workers=address)
    fly_campaign(loaded, tmp_path / "near", workers=1)
    assert rows(tmp_path / "far") == rows(tmp_path / "near")


def test_a_worker_whose_file_differs_refuses_with_both_hashes(tmp_path) -> None:
    loaded = campaign(tmp_path, own("works"))
    method = tmp_path / "methods.py"
    wanted = sha256(method, "python")
    packages = tuple(versions().items())
    job = Job(loaded.spec.model_dump_json(), json.dumps(loaded.content), packages, files=loaded.files)
    assert loaded.files == ((str(method), wanted),)
    method.write_text(METHODS + "\n# changed\n", encoding="utf-8")
    with pytest.raises(CampaignError, match=f"SHA-256 {wanted}, .* has {sha256(method, 'python')}"):
        fly_batch(job, [0])
    method.unlink()
    with pytest.raises(CampaignError, match=rf"SHA-256 {wanted}\), but the worker at .* has no such file"):
        fly_batch(job, [0])


def test_a_campaign_does_not_go_on_with_another_file(tmp_path) -> None:
    loaded = campaign(tmp_path, own("works"))
    Store.create(tmp_path / "s", loaded).close()
    (tmp_path / "methods.py").write_text(METHODS + "\n# changed\n", encoding="utf-8")
    with pytest.raises(CampaignError, match="belongs to another campaign"):
        fly_campaign(loaded, tmp_path / "s", resume=True, workers=1)
