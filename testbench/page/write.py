"""Write the results of a run into a folder: tables, models, figures, one page; and its records as they are made."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbench.core.files import write_file
from testbench.page.labels import file_stem

if TYPE_CHECKING:
    from testbench.core.record import FlightRecord
    from testbench.core.store import ResultFolder
    from testbench.line import Keep
    from testbench.page.figure import Plate
    from testbench.page.html import Picture
    from testbench.page.tables import Table


def record_keeper(place: ResultFolder) -> Keep:
    """Return a function that saves each record as records/NAME.nc of a result, for ``run(keep=...)``."""

    def keep(name: str, record: FlightRecord) -> None:
        """Save one record under its name."""
        record.save(place.new / "records" / f"{file_stem(name)}.nc")

    return keep


def write_tables(tables: Iterable[Table], folder: Path) -> list[Path]:
    """Write each table as folder/tables/NAME.csv and NAME.json; return the paths."""
    out = []
    for table in tables:
        stem = file_stem(table.name)
        out.append(write_file(folder / "tables" / f"{stem}.csv", table.to_csv()))
        out.append(write_file(folder / "tables" / f"{stem}.json", table.to_json()))
    return out


def write_plates(plates: Iterable[Plate], folder: Path) -> tuple[list[Path], list[Picture]]:
    """Write each plate as folder/figures/NAME.png, return the paths and the pictures for a page.

    Within :func:`testbench.page.publish.published` they are written as it asks, with their data beside them.
    """
    from testbench.page.html import picture
    from testbench.page.publish import asked, publish

    how = asked()
    paths, pictures = [], []
    for plate in plates:
        if how is not None:
            paths += publish(plate, folder / "figures", how)
            pictures.append(picture(plate))
            continue
        drawing = plate.draw()
        paths.append(write_file(folder / "figures" / f"{file_stem(plate.name)}.png", drawing.png))
        pictures.append(picture(plate, drawing.svg))
    return paths, pictures


def json_text(content: Mapping[str, Any]) -> str:
    """Return a model or another set of named values as the text of a JSON file; infinite numbers are refused."""
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
