"""Data compatibility: the search for errors of instruments, which of them the data can tell, and the words for them."""
