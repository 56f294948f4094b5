"""gap/effects."""
