"""Files of HDF5, which netCDF files are."""

from typing import BinaryIO

_SIGNATURE = b"\x89HDF"


def require_whole(file: BinaryIO) -> None:
    """Refuse a file of HDF5 that is cut or damaged at its beginning; others pass.

    h5netcdf refuses it too, but then prints an error to stderr when it forgets what it could not open.

    Raises:
        OSError: HDF5 cannot open it.
    """
    import h5py  # slow to import

    whole = file.read(len(_SIGNATURE)) != _SIGNATURE
    file.seek(0)
    if not whole:
        with h5py.File(file, "r") as data:
            data.attrs.get("_nc3_strict")
        file.seek(0)
