"""The same flight many times, over distributions of anything in it."""
