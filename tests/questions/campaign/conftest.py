from pathlib import Path

import pytest
from clusters import Cluster
from short_campaigns import SHORT

from testbench.questions.campaign.load import load_campaign


@pytest.fixture
def written(tmp_path):
    """Write a campaign of short flights and return its file."""

    def write(head: str = "runs = 24", vary: str = "", old: str = "", new: str = "", name: str = "short") -> Path:
        text = SHORT.format(head=head, vary=vary)
        assert old in text
        file = tmp_path / f"{name}.toml"
        file.write_text(text.replace(old, new) if old else text, encoding="utf-8")
        return file

    return write


@pytest.fixture
def short(written):
    """Load a campaign of short flights."""
    return lambda *args, **kwargs: load_campaign(written(*args, **kwargs))


@pytest.fixture
def cluster(tmp_path):
    found = Cluster(tmp_path)
    yield found
    found.stop()
