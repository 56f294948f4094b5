"""Strips: what the air does to the mode shapes of a slender aircraft, and what the modes do to the aircraft."""
