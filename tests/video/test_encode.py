"""The file: what is in it, and that nothing half-written is ever seen under its name."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from mjsheaf.errors import MjsheafError, PlaceError
from mjsheaf.video.draw import write_mp4

# Takes all frames and writes nothing. It is also asked, without -y, to read the result.
SWALLOW = '[ "$1" = -y ] && cat > /dev/null; exit 1'
# May not write more than a kilobyte, as where the disk is full.
SHORT_OF_SPACE = f'ulimit -f 2; exec {imageio_ffmpeg.get_ffmpeg_exe()} "$@"'


def grey(count: int, width: int = 98, height: int = 66) -> Iterator[Callable[[], Image.Image]]:
    for number in range(count):
        yield partial(Image.new, "RGB", (width, height), (20 * number % 256,) * 3)


@pytest.mark.parametrize("count", [12, 1])
def test_what_goes_in_comes_out(count: int, tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    assert write_mp4(path, grey(count), 24) == count  # no multiple of 16: nothing may be scaled
    reader = imageio_ffmpeg.read_frames(path)
    meta = next(reader)
    assert meta["codec"] == "h264"
    assert meta["pix_fmt"].startswith("yuv420p")
    assert meta["size"] == (98, 66)
    assert meta["fps"] == 24
    levels = [np.frombuffer(frame, np.uint8).mean() for frame in reader]
    np.testing.assert_allclose(levels, 20 * np.arange(count), atol=3)
    content = path.read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")  # plays while it loads
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_on_the_way_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    path.write_bytes(b"old")

    def frames() -> Iterator[Callable[[], Image.Image]]:
        yield from grey(3)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_mp4(path, frames(), 24)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(PlaceError, match=r"missing/a\.mp4"):
        write_mp4(tmp_path / "missing" / "a.mp4", grey(3), 24)


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("script", ["exit 1", SWALLOW, SHORT_OF_SPACE, "kill -9 $$"])
def test_ffmpeg_that_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    ffmpeg = tmp_path / "ffmpeg"
    ffmpeg.write_text(f"#!/bin/sh\n{script}\n")
    ffmpeg.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(ffmpeg))
    folder = tmp_path / "videos"
    folder.mkdir()
    with pytest.raises(MjsheafError, match=r"ffmpeg") as caught:
        write_mp4(folder / "a.mp4", grey(400, 640, 480), 24)
    assert "\n" not in str(caught.value)
    assert list(folder.iterdir()) == []
