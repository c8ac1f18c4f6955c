"""Frames in, an MP4 out: H.264, yuv420p, which plays everywhere."""

from collections import deque
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import imageio_ffmpeg

from mjsheaf.errors import InputError, MjsheafError
from mjsheaf.io.files import whole_file
from mjsheaf.video.renderer import Frame

QUALITY = 20  # x264's constant rate factor: 18 looks lossless, 23 is its default
AHEAD = 3  # frames drawn but not yet taken by the encoder
PRESET = "veryfast"  # the picture is the costly part, and x264 competes with it for the same cores
CONTAINER = ("-movflags", "+faststart", "-f", "mp4")  # named: the file's own name says it only in the end
X264 = "me=dia:subme=1:weightp=0:rc-lookahead=5:threads=2:lookahead-threads=1"
"""A third less work than the preset's, at the same size of such pictures, on few threads."""


_BLOCK = 1 << 20  # bytes; more than ffmpeg writes at a time


class UnwritableError(InputError):
    """A video's place cannot be written, or its disk is full."""


def write_mp4(path: Path, frames: Iterable[Frame], width: int, height: int, fps: float) -> int:
    """Encode frames as they come. The file appears under its name only when it is complete.

    Args:
        path: the file to write; one that exists is replaced.
        frames: each of shape (height, width, 3), RGB; at least one.
        width: even, in pixels.
        height: even, in pixels.
        fps: frames in a second.

    Returns:
        How many frames were written.

    Raises:
        UnwritableError: the file cannot be written.
        MjsheafError: ffmpeg is missing or fails.
    """
    try:
        with whole_file(path) as part:
            try:
                count = _encode(part, frames, width, height, fps)
                if abs(_duration(part) - count / fps) > 1 / fps + 0.01:  # ffmpeg gives hundredths of a second
                    raise MjsheafError(f"ffmpeg did not finish {path} ({count} frames)")
            except MjsheafError:
                _require_room(part)
                raise
    except OSError as error:
        raise UnwritableError(f"{path}: cannot be written: {error.strerror or error}") from error
    return count


def _require_room(part: Path) -> None:
    """See whether the disk is why ffmpeg failed, which does not tell.

    Raises:
        OSError: it takes no more.
    """
    with part.open("ab", buffering=0) as file:
        room = bytes(_BLOCK)
        while room:
            room = room[file.write(room) :]


def _encode(part: Path, frames: Iterable[Frame], width: int, height: int, fps: float) -> int:
    """Feed the frames to ffmpeg while the next ones are drawn; returns how many there were."""
    writer = imageio_ffmpeg.write_frames(
        part,
        (width, height),
        pix_fmt_in="rgb24",
        pix_fmt_out="yuv420p",
        fps=fps,
        codec="libx264",
        quality=None,
        macro_block_size=1,  # of the size as asked: it is even, which is all that yuv420p needs
        ffmpeg_log_level="quiet",
        output_params=["-crf", str(QUALITY), "-preset", PRESET, "-x264-params", X264, *CONTAINER],
    )
    count = 0
    sent: deque[Future[None]] = deque()

    def wait(most: int) -> None:
        """Wait until so many frames, at most, are not yet taken."""
        while len(sent) > most:
            try:
                sent.popleft().result()
            except OSError as error:
                taken = count - len(sent) - 1
                raise MjsheafError(f"ffmpeg stopped after {taken} frames: {_first_line(error)}") from error

    with closing(writer), ThreadPoolExecutor(1) as feeder:
        try:
            writer.send(None)  # starts ffmpeg
        except (OSError, RuntimeError) as error:
            raise MjsheafError(f"cannot start ffmpeg: {_first_line(error)}") from error
        for frame in frames:
            sent.append(feeder.submit(writer.send, frame))
            count += 1
            wait(AHEAD)
        wait(0)
    return count


def _duration(part: Path) -> float:
    """Read a video's length in s, -1 if it is none: ffmpeg's exit status is not to be had."""
    try:
        with closing(imageio_ffmpeg.read_frames(part)) as reader:
            return float(next(reader)["duration"])
    except (OSError, RuntimeError, StopIteration):
        return -1.0


def _first_line(error: Exception) -> str:
    return str(error).strip().split("\n")[0] or type(error).__name__
