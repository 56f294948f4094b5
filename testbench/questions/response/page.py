"""The page of measured frequency responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.page import COMPUTED, Page, source_of
from testbench.questions.response.answer import response_answer
from testbench.questions.response.figures import response_plates
from testbench.questions.response.tables import response_table

if TYPE_CHECKING:
    from testbench.estimators.frequency.response import FrequencyResponse
    from testbench.questions.identify.scenario import RecordDescription


def response_page(response: FrequencyResponse, description: RecordDescription) -> Page:
    """Return the page of the frequency responses of recorded flights; their long table is only in a file."""
    return Page(
        kicker=f"Frequency responses: {description.name}",
        title=description.title,
        answer=response_answer(response),
        more_tables=[response_table(response)],
        plates=response_plates(response),
        packages=COMPUTED,
        source=source_of(description),
    )
