"""Pictures and films written to files, each complete or not at all."""

from __future__ import annotations

import re
import shutil
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gantrysim.base.errors import GantryError, InputError, positive, text_of
from gantrysim.base.extras import extra
from gantrysim.base.files import replaced

Picture = NDArray[np.uint8]

_MP4 = ".mp4"
_GIF = ".gif"
FILMS = (_MP4, _GIF)
PICTURES = (".png",)

_HUNDREDTHS = 100.0  # of a second, the unit of a GIF's frame times
_SHORTEST = 2  # frame time that players respect; many show shorter ones for a tenth of a second
_LONGEST = 65535  # frame time of the format
# Players guess the colour space of unlabelled films differently; with its index in front a film plays while it loads.
_MP4_OPTIONS = (
    "-vf scale=out_color_matrix=bt709:out_range=tv,"
    "setparams=range=tv:colorspace=bt709:color_primaries=bt709:color_trc=bt709 "
    # with fewer searches than veryfast's own a frame takes a quarter less time, for a film 6 % larger
    "-c:v libx264 -preset veryfast -crf 16.5 -x264-params subme=1:partitions=p8x8,b8x8,i4x4 "
    "-pix_fmt yuv420p -movflags +faststart"
)
_GIF_OPTIONS = "-lavfi paletteuse=dither=none -c:v gif -loop 0"
_MESSAGES = 20  # last lines of an encoder's messages that are remembered
_FINEST_RATE = 1_000_000  # denominator of frames per second as a fraction


def suffix_of(file: Path, known: Sequence[str]) -> str:
    """Return the suffix of a file to be written, in lower case.

    Raises:
        InputError: an unknown suffix, a folder, or no such parent folder.
    """
    suffix = file.suffix.lower()
    if suffix not in known:
        raise InputError(f"file {file}: suffix = {file.suffix!r}: must be {' or '.join(known)}")
    if file.is_dir():
        raise InputError(f"file {file}: is a folder")
    if not file.absolute().parent.is_dir():
        raise InputError(f"file {file}: no such folder {file.parent}")
    return suffix


def film_rate(file: Path, fps: float) -> float:
    """Return the frames per second of a film; for a GIF the nearest possible.

    Raises:
        InputError: not above 0, or another suffix.
    """
    requested = positive("frames per second", fps, "1/s")
    if suffix_of(file, FILMS) != _GIF:
        return requested
    return _HUNDREDTHS / min(max(round(_HUNDREDTHS / requested), _SHORTEST), _LONGEST)


@contextmanager
def film_writer(
    file: Path, fps: float, size: tuple[int, int], samples: Callable[[], Sequence[Picture]]
) -> Iterator[Callable[[Picture], None]]:
    """Give a function that appends a frame to a new film.

    Args:
        file: to write.
        fps: frames per second, from `film_rate`.
        size: width and height of the frames [pixels].
        samples: gives frames with all colours of the film, for the palette of a GIF.

    Raises:
        InputError: a file that cannot be written, or an odd size of an MP4.
        MissingPackageError: imageio-ffmpeg is not installed.
        NoEncoderError: no ffmpeg.
    """
    suffix = suffix_of(file, FILMS)
    width, height = size
    if suffix == _MP4 and (width % 2 or height % 2):
        raise InputError(f"size of the video = {width} x {height}: must be even numbers of pixels")
    with replaced(file) as partial:
        options = _MP4_OPTIONS.split()
        if suffix == _GIF:
            palette = partial.with_name("palette.png")
            colours = _palette(samples())
            colours.save(palette)
            options = ["-i", str(palette), *_GIF_OPTIONS.split()]
        command = [encoder_file(), "-y", "-v", "error", *_frames(fps, size), *options, str(partial)]
        # imageio_ffmpeg.write_frames ignores the exit status: a film that a full disk cuts off would pass as whole
        # a new session keeps Ctrl-C away from it; with Python's ignored signals it reports a limit on file sizes
        encoder = subprocess.Popen(
            command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, restore_signals=False
        )
        stdin = encoder.stdin
        stderr = encoder.stderr
        assert stdin is not None
        assert stderr is not None
        # messages are read at once: the pipe must not fill up
        messages: deque[bytes] = deque(maxlen=_MESSAGES)
        listener = threading.Thread(target=messages.extend, args=(stderr,), name="encoder", daemon=True)
        listener.start()

        def append(frame: Picture) -> None:
            try:
                stdin.write(np.ascontiguousarray(frame).data)
            except BrokenPipeError:
                raise _StoppedError from None

        complete = False
        try:
            with suppress(_StoppedError):
                yield append
                complete = True
            with suppress(BrokenPipeError):
                stdin.close()
            encoder.wait()
        finally:
            encoder.kill()  # after an error, and an interrupt
            with suppress(BrokenPipeError):
                stdin.close()
            encoder.wait()
            listener.join()
            stderr.close()
        if not complete or encoder.returncode:
            raise InputError(f"file {file}: cannot be written: {_reason(messages, encoder.returncode)}")


def _frames(fps: float, size: tuple[int, int]) -> list[str]:
    """Return the encoder's arguments for frames without headers from its standard input."""
    width, height = size
    rate = Fraction(fps).limit_denominator(_FINEST_RATE)
    return ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(rate), "-i", "-"]


class NoEncoderError(GantryError, RuntimeError):
    """No ffmpeg that encodes films."""


def encoder_file() -> str:
    """Return the file of ffmpeg.

    Raises:
        MissingPackageError: imageio-ffmpeg is not installed.
        NoEncoderError: there is none that can be run.
    """
    with extra("film", "no encoder"):
        from imageio_ffmpeg import get_ffmpeg_exe
    try:
        file = get_ffmpeg_exe()
    except RuntimeError as error:
        raise NoEncoderError(f"no encoder: {text_of(error)}: reinstall imageio-ffmpeg") from None
    if shutil.which(file) is None:
        raise NoEncoderError(f"no encoder: {file} cannot be run: reinstall imageio-ffmpeg or unset IMAGEIO_FFMPEG_EXE")
    return str(file)


class _StoppedError(Exception):
    """The encoder no longer accepts frames."""


def save_picture(file: Path, picture: Picture) -> None:
    """Write a picture, (height, width, 3), as PNG.

    Raises:
        InputError: another suffix, or a file that cannot be written.
    """
    suffix_of(file, PICTURES)
    with replaced(file) as partial:
        Image.fromarray(picture).save(partial)


def _reason(messages: Iterable[bytes], status: int) -> str:
    """Return why an encoder failed: its last message without the name of ffmpeg's component, or its exit status."""
    lines = [line.decode(errors="replace").strip() for line in messages]
    reasons = [re.sub(r"^\[[^]]* @ [^]]*\] ", "", line) for line in lines if line]
    if reasons:
        return reasons[-1]
    return f"the encoder stopped by signal {-status}" if status < 0 else "the encoder stopped"


def _palette(samples: Sequence[Picture]) -> Image.Image:
    """Return the 256 colours of frames, as a picture of 16 x 16.

    Half of them divide the pixels evenly, for smooth shades; half the colour space, for rare colours as of a thin bead.
    """
    image = Image.fromarray(np.concatenate(samples))
    colours = np.zeros((256, 3), np.uint8)
    for first, method in ((0, Image.Quantize.MEDIANCUT), (128, Image.Quantize.MAXCOVERAGE)):
        palette = image.quantize(128, method, dither=Image.Dither.NONE).getpalette() or []
        half = np.array(palette, np.uint8).reshape(-1, 3)[:128]
        colours[first : first + len(half)] = half
    return Image.fromarray(colours.reshape(16, 16, 3))
