"""Data compatibility: the search for the errors of instruments, what the data can tell, and how it is said."""
