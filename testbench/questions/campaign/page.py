"""The page of a campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.aircraft.believed import KEY
from testbench.core.constants import PERCENT
from testbench.page.flown import flown_table
from testbench.page.labels import number
from testbench.page.page import Page
from testbench.questions.campaign.answer import campaign_answer, cost_sentence
from testbench.questions.campaign.figures import campaign_plates
from testbench.questions.campaign.methods import ranked_contests
from testbench.questions.campaign.scenario import Normal
from testbench.questions.campaign.tables import campaign_tables, runs_csv, tally_of
from testbench.questions.campaign.tidy import tidy_files
from testbench.questions.side_by_side import rank_plates

if TYPE_CHECKING:
    from testbench.questions.campaign.result import CampaignResult


def campaign_page(result: CampaignResult) -> Page:
    """Return the page of a campaign, with tables/runs.csv: every finished run with all its figures."""
    spec, own, cost = result.campaign.spec, result.campaign.own, cost_sentence(result)
    return Page(
        kicker=f"Campaign: {spec.name}",
        title=spec.title,
        question=spec.question,
        answer=campaign_answer(result),
        tables=campaign_tables(result),
        more_tables=[flown_table(tally_of(result.summary), "run")],
        plates=[*campaign_plates(result.summary), *rank_plates(*ranked_contests(result))],
        files={"tables/runs.csv": runs_csv(result.summary), **tidy_files(result.folder, result.counts.finished)},
        template="questions/campaign/page.html.j2",
        asked=[
            *((key, f"grid: {', '.join(map(str, values))}") for key, values in spec.grid.items()),
            *((key, _law(law)) for key, law in spec.vary.items() if key not in own),
            *([("coefficients", _own(result))] if own else []),
            ("cost", cost),
        ],
        provenance=[("seed", str(spec.seed))],
        source=(f"{spec.name}.toml", result.campaign.text),
        notes=[cost],
    )


def _own(result: CampaignResult) -> str:
    """Return in words what is drawn by the aircraft's own uncertainty."""
    laws = [(key, result.campaign.spec.vary[key]) for key in result.campaign.own]
    listed = ", ".join(
        f"{key.removeprefix(KEY)} {number(law.std / PERCENT)} %" for key, law in laws if isinstance(law, Normal)
    )
    return (
        "by the uncertainty that the aircraft states, each on its own: factors on the believed values, normal about 1 "
        f"with the relative standard deviations {listed}"
    )


def _law(law: object) -> str:
    """Return a distribution in words."""
    fields = dict(law)  # type: ignore[call-overload]
    kind = fields.pop("kind")
    said = ", ".join(
        f"{k} {', '.join(map(str, v)) if isinstance(v, tuple) else v}" for k, v in fields.items() if v != ()
    )
    return f"{kind}: {said}"
