"""A record or an identified model as a file for another program."""
