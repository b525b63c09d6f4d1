"""Models of free packages, for tests that skip where these are not on disk.

`PSGN_FREE_MESHES` names a folder of Debian's packages, unpacked with `dpkg-deb -x`; without it they
are looked for where they are installed, below /usr.
"""

import os
import pathlib

import pytest

from data_gen.catalogues.by_name import open_catalogue

_FOLDERS = {
    "sh3f": ("sweethome3d-furniture", "share/sweethome3d/furniture"),
    "ac3d": ("flightgear-data-models", "share/games/flightgear/Models"),
}


def entries(catalogue):
    """The entries of a catalogue, by its name; the test that asks for them may be skipped."""
    package, place = _FOLDERS[catalogue]
    packages = os.environ.get("PSGN_FREE_MESHES")
    root = pathlib.Path(packages) / package / "usr" if packages else pathlib.Path("/usr")
    if not (root / place).is_dir():
        pytest.skip(f"{package} is not on disk (PSGN_FREE_MESHES)")
    return list(open_catalogue(catalogue, root / place).entries())


def model(catalogue, name):
    """The model of that name."""
    (found,) = (e for e in entries(catalogue) if e.model_id == name)
    return found.load()
