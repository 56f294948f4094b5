"""Recorded flights: readers of log and table formats, and the records that they hold."""
