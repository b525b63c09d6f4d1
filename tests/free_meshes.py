"""Models of free packages, for tests that are skipped if the packages are not on disk.

`PSGN_FREE_MESHES` names a folder of Debian's packages, unpacked with `dpkg-deb -x`. Without it, the
installed packages below /usr are used.
"""

import os
import pathlib
import re

import pytest

from data_gen.catalogues.by_name import open_catalogue
from data_gen.sets import free

_FOLDERS = {
    "sh3f": ("sweethome3d-furniture", "share/sweethome3d/furniture"),
    "ac3d": ("flightgear-data-models", "share/games/flightgear/Models"),
}


def _place(package, path):
    """A path of a package on this disk; the test that asks for it may be skipped."""
    packages = os.environ.get("PSGN_FREE_MESHES")
    place = (pathlib.Path(packages) / package if packages else pathlib.Path("/")) / path
    if not place.exists():
        pytest.skip(f"{package} is not on disk (PSGN_FREE_MESHES)")
    return place


def entries(catalogue):
    """The entries of a catalogue, by its name; the test that asks for them may be skipped."""
    package, path = _FOLDERS[catalogue]
    return list(open_catalogue(catalogue, _place(package, f"usr/{path}")).entries())


def entries_of_source(name):
    """The entries of a source of the free set, as `entries` of a catalogue."""
    source = next(s for s in free.SOURCES if s.name == name)
    place = _place(source.package, source.place) if source.package else source.place
    found = open_catalogue(source.catalogue, place, **source.options).entries()
    return [e for e in found if not source.exclude or not re.search(source.exclude, e.model_id)]


def model(catalogue, name):
    """The model of that name."""
    (found,) = (e for e in entries(catalogue) if e.model_id == name)
    return found.load()
