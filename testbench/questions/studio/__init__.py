"""The studio: one interactive page that shows at once what an input does and tells, before anything is flown."""

from __future__ import annotations
