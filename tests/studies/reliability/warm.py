"""Import what commands import, so that processes that are forked from this one need not."""

import importlib
import io
from pathlib import Path

import testbench

LIBRARIES = (
    "matplotlib.figure", "matplotlib.backends.backend_agg", "matplotlib.backends.backend_svg",
    "matplotlib.backends.backend_pdf", "jinja2", "h5netcdf", "xarray", "pandas", "scipy.io", "pyarrow.parquet",
    "rich.table", "typer.rich_utils", "distributed",
)  # fmt: skip


def modules() -> list[str]:
    """Return the modules of the testbench that commands import, and large libraries."""
    package = Path(testbench.__file__).parent
    return [
        *(
            ".".join(file.relative_to(package.parent).with_suffix("").parts).removesuffix(".__init__")
            for file in sorted(package.rglob("*.py"))
            if file.stem != "__main__" and "envs" not in file.parts
        ),
        *LIBRARIES,
    ]


def warm() -> None:
    """Import them all, and draw once, which reads fonts."""
    for name in modules():
        try:
            importlib.import_module(name)
        except ModuleNotFoundError:  # an extra that is missing
            continue
    from matplotlib.figure import Figure

    figure = Figure()
    figure.add_subplot().set_title("$x$")
    figure.savefig(io.BytesIO(), format="png")
