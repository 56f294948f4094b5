"""The tree of all commands, built once: each command within one process would build it anew, in most of its time."""

from functools import cache

import typer.main
import typer.testing

from testbench.cli import app

typer.main.get_command = typer.testing._get_command = cache(typer.main.get_command)
typer.main.get_command(app)
