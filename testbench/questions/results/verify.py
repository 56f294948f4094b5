"""Whether a folder of results still is what was written, and what has changed of all that it was made from."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from testbench.core.errors import RecordError
from testbench.core.store import OWN, Manifest, entry_of, input_at, manifest_of, packages


@dataclass(frozen=True)
class Verified:
    """A folder of results, held against its manifest.

    Attributes:
        folder: of the result.
        manifest: what was written, by which command, from which inputs.
        changed: files that are not what was written.
        missing: files that are gone.
        extra: files that no manifest lists: the user's.
        inputs_changed: files that it was made from, which have changed since.
        inputs_gone: files that it was made from, which are no longer found.
        versions: (name, then, now) of the testbench and of packages whose versions differ.
    """

    folder: Path
    manifest: Manifest
    changed: tuple[str, ...]
    missing: tuple[str, ...]
    extra: tuple[str, ...]
    inputs_changed: tuple[str, ...]
    inputs_gone: tuple[str, ...]
    versions: tuple[tuple[str, str, str], ...]

    @property
    def whole(self) -> bool:
        """Whether every file still is what was written."""
        return not self.changed and not self.missing


def verify_results(folder: Path | str) -> Verified:
    """Hold a folder of results against its manifest.

    Raises:
        RecordError: it has no manifest, or a damaged one.

    Example:
        >>> import testbench as tb
        >>> tb.verify_results("results/eolo_alpha").whole  # doctest: +SKIP
        True
    """
    from testbench import __version__

    folder = Path(folder)
    manifest = manifest_of(folder)
    if manifest is None:
        raise RecordError(
            f"a result must have a manifest, but '{folder}' has none: it is no single result, or was made before there "
            "were manifests; run its command again into a new folder"
        )
    fixed = {name: entry for name, entry in manifest.files.items() if entry is not None}
    now = {name: entry_of(folder / name) for name in fixed}
    inputs = {name: input_at(name, folder) for name in manifest.inputs}
    then = {"flight-testbench": manifest.version, **manifest.packages}
    here = {"flight-testbench": __version__, **packages()}
    return Verified(
        folder,
        manifest,
        changed=tuple(name for name in fixed if now[name] not in (None, fixed[name])),
        missing=tuple(name for name in fixed if now[name] is None),
        extra=tuple(sorted(set(_files(folder)) - manifest.files.keys())),
        inputs_changed=tuple(n for n, p in inputs.items() if p is not None and entry_of(p) != manifest.inputs[n]),
        inputs_gone=tuple(name for name, path in inputs.items() if path is None),
        versions=tuple((name, old, here.get(name, "none")) for name, old in then.items() if here.get(name) != old),
    )


def _files(folder: Path) -> list[str]:
    """Return the files in a folder, without those of results that lie in it."""
    found = []
    for place, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if name != OWN and not (Path(place) / name / OWN).is_dir()]
        found += [(Path(place) / name).relative_to(folder).as_posix() for name in files]
    return found
