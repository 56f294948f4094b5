"""The command line: parse, call one function, print. Everything heavy is imported inside the command that needs it."""

# Commands stand in the help in the order in which their modules are imported here.
from testbench.cli import flights, records, gap, planning, catalogue, campaigns, teaching  # isort: skip
from testbench.cli.app import app, main

__all__ = ["app", "campaigns", "catalogue", "flights", "gap", "main", "planning", "records", "teaching"]
