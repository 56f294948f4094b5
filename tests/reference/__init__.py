"""Independent references that the package is tested against."""
