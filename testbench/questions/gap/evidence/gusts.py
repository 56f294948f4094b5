"""A gust that one record met: which record that is, and what its manoeuvre is called."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from hashlib import blake2b

import numpy as np

from testbench.core.record import FlightRecord


@lru_cache(maxsize=128)
def record_key(record: FlightRecord) -> str:
    """Return what identifies a record: a digest of its times, channels, samples and validity.

    The noise of the sensors makes it another one when the same manoeuvre is flown again.
    """
    digest = blake2b("\0".join(record.channels).encode(), digest_size=16)
    for part in (record.t_s, record.data, record.valid):
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()


def called(records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    """Return records each of which says what its manoeuvre is called: by its name, where it does not say yet."""
    return {
        name: record if _called(record) else replace(record, provenance={**record.provenance, "manoeuvre": name})
        for name, record in records.items()
    }


def manoeuvre_of(record: FlightRecord, number: int) -> str:
    """Return the name of the manoeuvre as the provenance has it, or else "record NUMBER"."""
    return _called(record) or f"record {number}"


def _called(record: FlightRecord) -> str:
    truth = record.provenance.get("truth")
    for source in (record.provenance, truth if isinstance(truth, Mapping) else {}):
        if isinstance(source.get("manoeuvre"), str):
            return str(source["manoeuvre"])
    return ""
