"""Data sets of others, fetched when asked for and checked by their hashes.

Nothing of them is part of this package.  ``paper-data`` are the rows of headings and velocities
that the paper's authors publish at github.com/esheroe/EvCalib (no licence is given), which
`data_tools.logs.series_files.read_paired_streams` reads.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from evcalib.errors import InputError


@dataclass(frozen=True)
class DataSet:
    """Files under one address.

    Attributes
    ----------
    base : str
        Address, to which the names are appended.
    sha256 : dict of str to str
        Hash of each file by its name.
    """

    base: str
    sha256: dict[str, str]


DATA_SETS = {
    "paper-data": DataSet(
        "https://github.com/esheroe/EvCalib/raw/41817c9585ed8f6377dcaf1e3a4ab696cc2065e5/data/",
        {
            "calib_data_time_2traj.npz": (
                "9b11d30027f6e039747466d6c380085cff3ad4ee136dee7b42d85a1099c8d96d"
            ),
            "calib_data_time_3traj.npz": (
                "a10dd90b5f4ecce258bc0dc55d95711faa3fb9055cf43facef4ef9607cf3484d"
            ),
            "calib_data_time_4traj.npz": (
                "68d3bbe67dce72df372471de27d89a07ff45226caa49bc0e13523eaf09a3e227"
            ),
            "calib_data_time_5traj.npz": (
                "1f20a4a3ffdc2850e8b147b2e463ce0f0d6e2a97a1db8389059879767fa94123"
            ),
        },
    )
}


def fetch(name: str, *, folder: str | Path | None = None) -> Path:
    """Return the folder with the files of a data set, downloading those that are not there yet.

    Parameters
    ----------
    name : str
        One of `DATA_SETS`.
    folder : path, optional
        Where the files are kept; by default the user's cache.  Files that are in it already serve
        without a network.

    Returns
    -------
    Path
        The folder; each file of the data set in it has the hash that it should have.

    Raises
    ------
    InputError
        If the name is unknown, a file in the folder is another than it should be, or a download
        fails or is not what it should be.
    """
    import pooch

    if name not in DATA_SETS:
        raise InputError(f"there is no data set {name!r}, only {', '.join(DATA_SETS)}")
    content = DATA_SETS[name]
    place = Path(folder) if folder is not None else Path(pooch.os_cache("evcalib")) / name
    if place.exists() and not place.is_dir():
        raise InputError(f"{place} is no folder")
    for file in content.sha256:
        _fetch_file(content, file, place)
    return place


def _fetch_file(content: DataSet, name: str, place: Path) -> None:
    import pooch

    path, wanted = place / name, content.sha256[name]
    try:
        if path.exists():
            have = pooch.file_hash(str(path), alg="sha256")
            if have != wanted:
                raise InputError(
                    f"{path} is not the file of the data set: its sha256 is {have}, not {wanted};"
                    " remove it to have it fetched again"
                )
            return
        downloader = pooch.HTTPDownloader(timeout=30)
        pooch.retrieve(content.base + name, f"sha256:{wanted}", name, place, downloader=downloader)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"cannot fetch {name} from {content.base}: {error}") from None
    except OSError as error:  # those of the package requests too: no network, a wrong address
        why = error.strerror or type(error).__name__
        raise InputError(
            f"cannot fetch {name} from {content.base}: {why}; without a network, put the file into"
            f" {place}"
        ) from None
