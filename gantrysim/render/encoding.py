"""Pictures written to files: films frame by frame, single ones; a file is there when it is whole, or not at all."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gantrysim.errors import InputError, positive
from gantrysim.report import partial_name

__all__ = ["FILMS", "PICTURES", "film_rate", "film_writer", "save_picture", "suffix_of"]

Picture = NDArray[np.uint8]

_MP4, _GIF = ".mp4", ".gif"
FILMS = (_MP4, _GIF)
PICTURES = (".png",)

_HUNDREDTHS = 100.0  # of a second, in which a GIF says how long each of its frames stays
_SHORTEST, _LONGEST = 2, 65535  # of these, that players keep to, and that it can say
_QUALITY = 8  # of 10
# What is not labelled is taken by some players for the colours of old television, by others for those of new; with its
# index in front, a film plays while it is still loaded.
_MP4_OPTIONS = (
    "-vf scale=out_color_matrix=bt709:out_range=tv,"
    "setparams=range=tv:colorspace=bt709:color_primaries=bt709:color_trc=bt709 -movflags +faststart"
)
_STOPPED = "the encoder stopped"  # which has said why by itself


def suffix_of(file: Path, known: Sequence[str]) -> str:
    """Return the suffix of a file to be written, in lower case.

    Raises:
        InputError: none of the known ones, a folder, or in no folder that there is.
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
    """Return the frames per second of a film: those asked for, or of a GIF the nearest that it can say.

    Raises:
        InputError: not above 0, or another suffix.
    """
    asked = positive("frames per second", fps, "1/s")
    if suffix_of(file, FILMS) != _GIF:
        return asked
    return _HUNDREDTHS / min(max(round(_HUNDREDTHS / asked), _SHORTEST), _LONGEST)


@contextmanager
def film_writer(
    file: Path, fps: float, size: tuple[int, int], samples: Callable[[], Sequence[Picture]]
) -> Iterator[Callable[[Picture], None]]:
    """Give a function that appends a frame to a new film.

    Args:
        file: to write.
        fps: frames per second, as `film_rate` gives them.
        size: width and height of the frames [pixels].
        samples: gives frames that have between them all colours of the film, for the one palette of a GIF.

    Raises:
        InputError: a file that cannot be written, or an odd size of an MP4.
    """
    from imageio_ffmpeg import count_frames_and_secs, write_frames

    suffix = suffix_of(file, FILMS)
    width, height = size
    if suffix == _MP4 and (width % 2 or height % 2):
        raise InputError(f"size of the video = {width} x {height}: must be even numbers of pixels")
    frames = 0
    with _partial(file) as partial, tempfile.TemporaryDirectory() as scratch:
        options: dict[str, Any]
        if suffix == _MP4:
            options = {"codec": "libx264", "quality": _QUALITY, "output_params": _MP4_OPTIONS.split()}
        else:
            palette = Path(scratch) / "palette.png"
            _palette(samples()).save(palette)
            options = {"codec": "gif", "quality": None, "pix_fmt_out": "pal8"}
            mapped = f"movie={_in_a_filter(palette)}[palette];[0:v][palette]paletteuse=dither=none"
            options["output_params"] = ["-lavfi", mapped, "-loop", "0"]
        writer = write_frames(partial, size, fps=fps, macro_block_size=1, ffmpeg_log_level="error", **options)
        writer.send(None)  # starts the encoder

        def append(frame: Picture) -> None:
            nonlocal frames
            try:
                writer.send(np.ascontiguousarray(frame))
            except OSError:
                raise InputError(f"file {file}: cannot be written: {_STOPPED}") from None
            frames += 1

        try:
            yield append
        except BaseException:
            with suppress(KeyboardInterrupt):  # at which the encoder is killed; closed, it would end the film first
                writer.throw(KeyboardInterrupt())
            raise
        writer.close()
        # what the encoder could not write at the end, it does not tell
        if count_frames_and_secs(partial)[0] != frames:
            raise InputError(f"file {file}: cannot be written: {_STOPPED}")


def save_picture(file: Path, picture: Picture) -> None:
    """Write a picture, (height, width, 3), as PNG.

    Raises:
        InputError: another suffix, or a file that cannot be written.
    """
    import imageio.v3 as imageio

    suffix_of(file, PICTURES)
    with _partial(file) as partial:
        imageio.imwrite(partial, picture)


@contextmanager
def _partial(file: Path) -> Iterator[Path]:
    """Give a hidden file beside a file, that takes its place on success and is gone otherwise."""
    target = file.absolute()
    partial = target.with_name(partial_name(target.name))
    try:
        try:
            partial.touch()
        except OSError as error:
            raise InputError(f"file {file}: cannot be written: {error.strerror}") from None
        yield partial
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def _in_a_filter(file: Path) -> str:
    """A file's name as FFmpeg's graphs of filters take it: escaped as a value, and once more as part of the graph."""
    return re.sub(r"([\\'\[\],;])", r"\\\1", re.sub(r"([\\':])", r"\\\1", str(file)))


def _palette(samples: Sequence[Picture]) -> Image.Image:
    """The 256 colours of frames, as a picture of 16 x 16."""
    counted = Image.fromarray(np.concatenate(samples)).quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    colours = np.zeros((256, 3), np.uint8)
    found = np.array(counted.getpalette(), np.uint8).reshape(-1, 3)[:256]
    colours[: len(found)] = found
    return Image.fromarray(colours.reshape(16, 16, 3))
