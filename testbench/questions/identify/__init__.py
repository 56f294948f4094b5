"""The same estimators and the same page for recorded flights."""
