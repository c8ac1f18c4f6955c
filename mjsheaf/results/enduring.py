"""A file that HDF5 can write to on a disk that is full."""

import io
import os
from pathlib import Path
from typing import Any


class EnduringFile(io.RawIOBase):
    """A file whose writes never fail as far as HDF5 can see.

    HDF5 does not survive a write that fails while it closes a file: it frees what it goes on to use, and the
    interpreter crashes. So this file accepts everything, keeps in memory what the disk refuses, where HDF5 may read it
    back, and remembers why. The caller asks for that after each piece (`raise_refusal`), before memory fills.

    Use it from a thread other than the main one: there no signal raises an exception inside HDF5's callbacks.

    Attributes:
        refusal: the first error of the disk; None while it holds all that was written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        self._place = self._size = 0
        self._refused: list[tuple[int, bytes]] = []
        self.refusal: OSError | None = None

    def raise_refusal(self) -> None:
        """Raise what the disk said.

        Raises:
            OSError: something could not be written, or read back.
        """
        if self.refusal is not None:
            raise OSError(self.refusal.errno, self.refusal.strerror, str(self._path))

    def write(self, data: Any, /) -> int:
        """Write all of `data`, or keep what the disk refuses."""
        rest, place = memoryview(data).cast("B"), self._place
        length = len(rest)
        self._place += length
        self._size = max(self._size, self._place)
        while rest and self.refusal is None:
            try:
                written = os.pwrite(self._descriptor, rest, place)
            except OSError as error:
                self.refusal = error
            else:
                rest, place = rest[written:], place + written
        if rest:
            self._refused.append((place, bytes(rest)))
        return length

    def readinto(self, buffer: Any, /) -> int:
        """Read back what was written, wherever it is; returns how many bytes there were."""
        view = memoryview(buffer).cast("B")
        begin, end = self._place, min(self._place + len(view), max(self._size, self._place))
        try:
            found = os.pread(self._descriptor, end - begin, begin)
        except OSError as error:
            self.refusal, found = self.refusal or error, b""
        view[: len(found)] = found
        view[len(found) : end - begin] = bytes(end - begin - len(found))  # beyond what the disk took
        for place, kept in self._refused:
            first, last = max(begin, place), min(end, place + len(kept))
            if first < last:
                view[first - begin : last - begin] = kept[first - place : last - place]
        self._place = end
        return end - begin

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        """Move to a place."""
        self._place = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._size}[whence]
        return self._place

    def tell(self) -> int:
        """The place."""
        return self._place

    def truncate(self, size: int | None = None, /) -> int:
        """Change the length."""
        self._size = self._place if size is None else size
        try:
            os.ftruncate(self._descriptor, self._size)
        except OSError as error:
            self.refusal = self.refusal or error
        return self._size

    def readable(self) -> bool:
        """It is."""
        return True

    def writable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It is."""
        return True

    def close(self) -> None:
        """Close it; a network's disk may refuse only now."""
        if not self.closed:
            super().close()
            try:
                os.close(self._descriptor)
            except OSError as error:
                self.refusal = self.refusal or error
