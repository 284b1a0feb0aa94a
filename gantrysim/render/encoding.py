"""Pictures and films written to files, each complete or not at all."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gantrysim.base.errors import GantryError, InputError, positive, text_of
from gantrysim.base.extras import extra
from gantrysim.base.files import replaced_file

Picture = NDArray[np.uint8]

_MP4 = ".mp4"
_GIF = ".gif"
FILMS = (_MP4, _GIF)
PICTURES = (".png",)

_GIF_RATE = 100.0  # of a second, the unit of a GIF's frame times
_SHORTEST_FRAME = 2  # frame time that players respect; many show shorter ones for a tenth of a second
_LONGEST_FRAME = 65535  # frame time of the format
# of write_frames: codec, format of pixels, options
# Players guess the colour space of unlabelled films differently; with its index in front a film plays while it loads.
_MP4_ENCODER = (
    "libx264",
    "yuv420p",
    "-vf scale=out_color_matrix=bt709:out_range=tv,"
    "setparams=range=tv:colorspace=bt709:color_primaries=bt709:color_trc=bt709 "
    # with fewer searches than veryfast's own a frame takes a quarter less time, for a film 6 % larger
    "-preset veryfast -crf 16.5 -x264-params subme=1:partitions=p8x8,b8x8,i4x4 -movflags +faststart",
)
# the first frame brings the palette, and is no part of the film
_GIF_ENCODER = (
    "gif",
    "pal8",
    "-vf split[first][all];[first]trim=end_frame=1,crop=16:16:0:0[palette];"
    "[all]trim=start_frame=1,setpts=PTS-STARTPTS[film];[film][palette]paletteuse=dither=none -loop 0",
)
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
    return _GIF_RATE / min(max(round(_GIF_RATE / requested), _SHORTEST_FRAME), _LONGEST_FRAME)


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
        InputError: a file that cannot be written whole, or an odd size of an MP4.
        MissingPackageError: imageio-ffmpeg is not installed.
        NoEncoderError: no ffmpeg.
    """
    suffix = suffix_of(file, FILMS)
    if suffix == _MP4 and (size[0] % 2 or size[1] % 2):
        raise InputError(f"size of the video = {size[0]} x {size[1]}: must be even numbers of pixels")
    encoder_file()
    from imageio_ffmpeg import write_frames

    with replaced_file(file) as partial:
        codec, pixels, options = _GIF_ENCODER if suffix == _GIF else _MP4_ENCODER
        rate = Fraction(fps).limit_denominator(_FINEST_RATE)
        encoder = write_frames(
            str(partial),
            size,
            fps=rate,
            codec=codec,
            pix_fmt_out=pixels,
            quality=None,
            macro_block_size=1,
            ffmpeg_log_level="quiet",
            output_params=options.split(),
        )
        written = 0

        def append(frame: Picture) -> None:
            nonlocal written
            written += 1
            try:
                encoder.send(np.ascontiguousarray(frame))
            except (OSError, StopIteration):
                raise _StoppedError from None

        with closing(encoder):
            encoder.send(None)
            if suffix == _GIF:
                # of an encoder that has stopped, as the first frame tells
                with suppress(OSError):
                    encoder.send(_palette(samples()))
            with suppress(_StoppedError):
                yield append
        encoded = _frames_in(partial)
        if encoded != written:
            free = shutil.disk_usage(partial.parent).free / 1e6
            reason = f"the encoder wrote {encoded} of {written} frames; {free:.1f} MB are free"
            raise InputError(f"file {file}: cannot be written: {reason}")


def _frames_in(film: Path) -> int:
    """Return the number of whole frames of a film: the encoder's exit status, which would tell less, is not given."""
    from imageio_ffmpeg import count_frames_and_secs

    try:
        return int(count_frames_and_secs(film)[0])
    except RuntimeError:
        return 0


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
    with replaced_file(file) as partial:
        Image.fromarray(picture).save(partial)


def _palette(samples: Sequence[Picture]) -> Picture:
    """Return a frame with 256 colours of frames in its first 16 x 16 pixels, see `_GIF_ENCODER`.

    Half of them divide the pixels evenly, for smooth shades; half the colour space, for rare colours as of a thin bead.
    """
    image = Image.fromarray(np.concatenate(samples))
    colours = np.zeros((256, 3), np.uint8)
    for first, method in ((0, Image.Quantize.MEDIANCUT), (128, Image.Quantize.MAXCOVERAGE)):
        palette = image.quantize(128, method, dither=Image.Dither.NONE).getpalette() or []
        half = np.array(palette, np.uint8).reshape(-1, 3)[:128]
        colours[first : first + len(half)] = half
    frame = np.zeros_like(samples[0])
    frame[:16, :16] = colours.reshape(16, 16, 3)
    return frame
