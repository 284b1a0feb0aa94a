"""Damage to the bytes of a record, of every kind, drawn by a random generator."""

import io
import zipfile

import numpy as np

HUGE = 10**12


def members(content: bytes) -> dict[str, bytes]:
    """The files in an archive, by name."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {info.filename: archive.read(info) for info in archive.infolist()}


def archived(files: dict[str, bytes]) -> bytes:
    """An archive of files, each with a right CRC."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return stream.getvalue()


def array_file(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def announced(file: bytes, shape: tuple[int, ...]) -> bytes:
    """The file of an array whose header announces another shape."""
    stream = io.BytesIO(file)
    np.lib.format.read_magic(stream)
    _, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    header = io.BytesIO()
    descr = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": fortran, "shape": shape}
    np.lib.format.write_array_header_1_0(header, descr)
    return header.getvalue() + stream.read()


def _flip(rng, data):
    data = bytearray(data)
    for _ in range(rng.integers(1, 9)):
        data[rng.integers(len(data))] ^= 1 << rng.integers(8)
    return bytes(data)


def _cut(rng, data):
    return data[: rng.integers(len(data))]


def _parts(rng, data):
    a, b, c = sorted(rng.integers(len(data), size=3))
    return data[:a], data[a:b], data[b:c], data[c:]


def _repeat(rng, data):
    a, b, c, d = _parts(rng, data)
    return a + b + b + c + d


def _drop(rng, data):
    a, _, c, d = _parts(rng, data)
    return a + c + d


def _swap(rng, data):
    a, b, c, d = _parts(rng, data)
    return a + c + b + d


def _empty(rng, data):
    a, b, c, d = _parts(rng, data)
    return a + bytes(len(b)) + c + d


RAW = (_flip, _cut, _repeat, _drop, _swap, _empty)


def raw(rng: np.random.Generator, content: bytes) -> bytes:
    """Bytes of the file flipped, cut, repeated, dropped, swapped or zeroed."""
    return RAW[rng.integers(len(RAW))](rng, content)


def _bytes_of_a_member(rng, files, name):
    files[name] = raw(rng, files[name])


def _missing(rng, files, name):
    del files[name]


def _renamed(rng, files, name):
    files["x" + name] = files.pop(name)


def _exchanged(rng, files, name):
    other = list(files)[rng.integers(len(files))]
    files[name], files[other] = files[other], files[name]


def _huge(rng, files, name):
    files[name] = announced(files[name], ((HUGE,), (HUGE, 3), (10**9, 10**9), (2**63,), (0,))[rng.integers(5)])


def _typed(rng, files, name):
    array = np.load(io.BytesIO(files[name]))
    types = ("<f4", "<i8", "<c16", "S8", "?", ">f8", "<U4")
    with np.errstate(all="ignore"):
        files[name] = array_file(np.zeros(array.shape, types[rng.integers(len(types))]))


def _shaped(rng, files, name):
    array = np.load(io.BytesIO(files[name]))
    files[name] = array_file((array[None], array.ravel()[:-1], np.repeat(array.ravel(), 2))[rng.integers(3)])


def _numbered(rng, files, name):
    array = np.load(io.BytesIO(files[name])).copy()
    wrong = (np.nan, np.inf, -np.inf, 1e308, -1.0, 0.0)[rng.integers(6)]
    if array.dtype.kind == "f":
        array.reshape(-1)[rng.integers(array.size)] = wrong
    elif array.dtype.kind == "U":
        text = str(array.reshape(-1)[0])
        array = np.full(array.shape, ("", "\n", "null", "[" * 99_999, text.replace("0", "1e999"))[rng.integers(5)])
    files[name] = array_file(array)


def _objects(rng, files, name):
    stream = io.BytesIO()
    np.save(stream, np.array([{"a": 1}], object), allow_pickle=True)
    files[name] = stream.getvalue()


INSIDE = (
    _bytes_of_a_member,
    _missing,
    _renamed,
    _exchanged,
    _huge,
    _typed,
    _shaped,
    _numbered,
    _objects,
)


def inside(rng: np.random.Generator, files: dict[str, bytes]) -> bytes:
    """A member removed, renamed, exchanged, replaced or changed, in an archive that is whole."""
    files = dict(files)
    name = list(files)[rng.integers(len(files))]
    INSIDE[rng.integers(len(INSIDE))](rng, files, name)
    return archived(files)
