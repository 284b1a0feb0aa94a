"""A damaged record is refused in one line, or read as it was; never half, never with a traceback, never from a bomb."""

import dataclasses
import io
import math
import struct
import tracemalloc
import warnings
import zipfile
from hashlib import sha256

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError, Machine, Run, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.record.run_file import Fault

from support.damage import announced, archived, array_file, inside, members, raw
from support.runs import ideal_motors
from support.soaked import examples

MOST = 24 << 20  # memory that reading a damaged record of 0.4 MB may take [bytes]


@pytest.fixture(scope="module")
def record(xy) -> Run:
    run = simulate(xy, Servo.derive(xy.axes), MoveSpiral(40, 1, 10, 200).setpoints(1e-3))
    return dataclasses.replace(run, fault=Fault("travel", "x", 0.1, 1.0, 2.0, "mm"))


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged") / "run.npz"


@pytest.fixture(scope="module")
def content(record, place) -> bytes:
    record.save(place)
    return place.read_bytes()


def checksum(files: dict[str, bytes]) -> str:
    """The SHA-256 of members, as anyone can compute it: format first, then the others by name."""
    order = sorted(files.keys() - {"sha256.npy"}, key=lambda name: (name != "format.npy", name.removesuffix(".npy")))
    return sha256(b"".join(name.removesuffix(".npy").encode() + b"\0" + files[name] for name in order)).hexdigest()


def sealed(damaged: bytes) -> bytes:
    """The archive with a checksum that agrees with its damaged members."""
    files = members(damaged)
    return archived(files | {"sha256.npy": array_file(np.array(checksum(files)))})


def same(one: Run, other: Run) -> bool:
    return (
        all(
            np.array_equal(a, b, equal_nan=True) if isinstance(a, np.ndarray) else a == b
            for f in dataclasses.fields(Run)
            if f.name not in ("requested", "rig")
            for a, b in [(getattr(one, f.name), getattr(other, f.name))]
        )
        and one.requested.parameters() == other.requested.parameters()
    )


def read(place, damaged: bytes) -> Run | None:
    """Read damaged bytes; None where they are refused in one line."""
    place.write_bytes(damaged)
    tracemalloc.start()
    found, text = None, ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = Run.load(place)
    except InputError as error:
        text = str(error)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < MOST
    if found is None:
        assert str(place) in text
        assert "\n" not in text
        assert len(text) < 600
    return found


def check_new(place, record, damaged):
    found = read(place, damaged)
    assert found is None or same(found, record)
    return found is None


def check_sealed(place, damaged):
    """Where the checksum agrees numbers may be others, but none that is not finite or out of time."""
    found = read(place, damaged)
    if found is not None:
        for field in dataclasses.fields(Run):
            value = getattr(found, field.name)
            if isinstance(value, np.ndarray):
                assert len(value) == len(found.time)
                assert np.isfinite(value).all()
        np.testing.assert_allclose(np.diff(found.time), found.period, rtol=1e-6)
        assert 0 < found.requested.length < np.inf
    return found is None


def seeds(most):
    return st.integers(0, most)


@given(seed=seeds(1 << 30))
@examples(60)
def test_bytes_of_the_file(place, record, content, seed):
    check_new(place, record, raw(np.random.default_rng(seed), content))


@given(seed=seeds(1 << 30))
@examples(60)
def test_members_of_the_archive(place, record, content, seed):
    check_new(place, record, inside(np.random.default_rng(seed), members(content)))


@given(seed=seeds(1 << 30))
@examples(60)
def test_members_whose_checksum_agrees(place, content, seed):
    check_sealed(place, sealed(inside(np.random.default_rng(seed), members(content))))


@pytest.mark.soak
def test_many_damaged_records(place, record, content, record_property):
    refused = [0, 0, 0]
    for seed in range(4000):
        rng = np.random.default_rng(seed)
        refused[0] += check_new(place, record, raw(rng, content))
        refused[1] += check_new(place, record, inside(rng, members(content)))
        refused[2] += check_sealed(place, sealed(inside(rng, members(content))))
    assert all(count > 3000 for count in refused)
    record_property("attack", "records: bytes changed, members removed, swapped or reshaped")
    record_property("tries", 12_000)
    record_property("refused", sum(refused))


def test_one_bit_of_any_number_is_noticed_although_the_archive_is_whole(place, content):
    """What the CRC of the archive cannot see: it is computed again when an archive is packed again."""
    files = members(content)
    for name in files.keys() - {"sha256.npy"}:
        data = bytearray(files[name])
        data[-1] ^= 1
        place.write_bytes(archived(files | {name: bytes(data)}))
        with pytest.raises(InputError):
            Run.load(place)
    data = bytearray(files["nozzle.npy"])
    data[-8] ^= 1  # the last bit of a coordinate
    place.write_bytes(archived(files | {"nozzle.npy": bytes(data)}))
    with pytest.raises(InputError, match="its sha256 does not match its content"):
        Run.load(place)


def test_a_record_packed_again_in_another_order_is_the_same(place, record, content):
    assert check_new(place, record, archived(dict(reversed(members(content).items())))) is False


def test_the_checksum_is_that_of_names_and_arrays(place, content):
    files = members(content)
    assert checksum(files) == str(np.load(io.BytesIO(files["sha256.npy"])))


@pytest.mark.parametrize("shape", [(10**12,), (10**12, 3), (2**62,)])
@pytest.mark.parametrize("name", ["nozzle", "time", "requested", "axes", "format"])
def test_a_header_that_announces_what_is_not_there(place, content, name, shape):
    files = members(content)
    files[f"{name}.npy"] = announced(files[f"{name}.npy"], shape)
    place.write_bytes(archived(files))
    with pytest.raises(InputError, match=rf"{name} has \d+ bytes, not those of"):
        Run.load(place)
    assert read(place, archived(files)) is None


def bomb(size: int) -> bytes:
    """An archive whose members expand to `size` bytes each, with headers that agree."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("time.npy", "nozzle.npy"):
            header = array_file(np.zeros(0))
            with archive.open(name, "w") as member:
                member.write(announced(header, (size // 8,)))
                for _ in range(size >> 20):
                    member.write(bytes(1 << 20))
    return stream.getvalue()


def test_a_bomb_is_refused_before_it_is_unpacked(place):
    packed = bomb(64 << 20)
    assert len(packed) < 1 << 20
    place.write_bytes(packed)
    with pytest.raises(InputError, match=r"\d+ bytes that expand to 1.34e\+08"):
        Run.load(place)
    assert read(place, packed) is None


def test_a_directory_that_understates_a_member(place, content):
    """The directory of the archive says 8 bytes less than there are."""
    at = content.rfind(b"PK\x01\x02")
    size = struct.unpack_from("<I", content, at + 24)[0]
    damaged = bytearray(content)
    struct.pack_into("<I", damaged, at + 24, size - 8)
    assert read(place, bytes(damaged)) is None


def test_nan_stands_only_where_the_format_allows_it(place, record):
    none = np.full_like(record.current, np.nan)
    ideal = dataclasses.replace(record, current=none, voltage=none)
    ideal.save(place)
    assert same(Run.load(place), ideal)
    one = record.current.copy()
    one[3, 0] = np.nan
    for name, values in (("current", one), ("nozzle", np.full_like(record.nozzle, np.nan))):
        dataclasses.replace(record, **{name: values}).save(place)
        with pytest.raises(InputError, match=rf"{name} has \d+ values that are not finite"):
            Run.load(place)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"period": 2e-3}, "time is not that of ticks every 0.002 s"),
        ({"period": -1e-3}, "period = -0.001"),
        ({"face": 0.0}, "face = 0"),
        ({"gap": np.nan}, "gap = nan"),
        ({"axes": ("x", "x")}, "axes x, x in mm, mm"),
        ({"units": ("mm", "inch")}, "axes x, y in mm, inch"),
        ({"machine": "a\nb"}, r"'a\\nb' is no name"),
        ({"axes": ("x",)}, "must have"),
        ({"fault": Fault("travel", "q", 0.1, 1.0, 2.0, "mm")}, "fault = "),
        ({"fault": Fault("travel", "x", float("nan"), 1.0, 2.0, "mm")}, "fault = "),
    ],
)
def test_a_record_that_contradicts_itself(place, record, changes, text):
    dataclasses.replace(record, **changes).save(place)
    with pytest.raises(InputError, match=text):
        Run.load(place)


@pytest.mark.parametrize("torque", [-1e300, 1e12])
def test_the_record_of_a_run_that_diverged_is_read(rigid, place, torque):
    machine = Machine(ideal_motors(rigid(current=0.0).source))  # whose torque has no limit
    servo = Servo.derive(machine.axes, following_error_limit=math.inf)
    run = simulate(machine, servo, MoveSpiral(40, 1, 10, 200).setpoints(1e-3), law=lambda tick: [torque, 0.0])
    assert run.fault is not None
    assert run.fault.kind == "diverged"
    run.save(place)
    assert same(Run.load(place), run)


def test_the_tick_that_diverged_may_have_no_torque(place, record):
    torque = record.torque.copy()
    torque[-1, 0] = np.nan
    dataclasses.replace(record, torque=torque).save(place)
    assert np.isnan(Run.load(place).torque[-1, 0])
    dataclasses.replace(record, torque=torque, fault=None).save(place)
    with pytest.raises(InputError, match="torque has 1 values that are not finite"):
        Run.load(place)


def put(name, value):
    """Replace a member, or add it."""
    return lambda files: files | {f"{name}.npy": array_file(value)}


def edited(name, change):
    """Change the array of a member."""

    def edit(files):
        array = np.load(io.BytesIO(files[f"{name}.npy"]))
        return files | {f"{name}.npy": array_file(change(array))}

    return edit


def without(name):
    return lambda files: {member: data for member, data in files.items() if member != f"{name}.npy"}


def at(place, value):
    def change(array):
        array[place] = value
        return array

    return change


def two_in_a_byte(array):
    array.view(np.uint8)[5] = 2
    return array


DAMAGES = {
    "it has no format": put("format", np.array("8")),
    "its format is 99, only format": put("format", np.array(99)),
    "its time or axes are missing": without("time"),
    "its time or axes are missing: no axes": put("axes", np.array([], "U1")),
    "nozzle is missing": without("nozzle"),
    "more is no member of a record": put("more", np.array(1.0)),
    "nozzle has the shape": edited("nozzle", lambda array: array[:, :2]),
    "encoder has the shape": edited("encoder", lambda array: array.astype(np.float32)),
    "axes x, y in m, mm": put("units", np.array(["m", "mm"])),
    "axes x, x in mm, mm": put("axes", np.array(["x", "x"])),
    "'' is no name": put("axes", np.array(["x", ""])),
    "'a\\nb' is no name": put("machine", np.array("a\nb")),
    "period = 0": put("period", np.array(0.0)),
    "period = nan": put("period", np.array(math.nan)),
    "gap = inf": put("gap", np.array(math.inf)),
    "time is not that of ticks every 0.001 s": edited("time", at(7, 0.0070001)),
    "dispense has values other than true and false": edited("dispense", two_in_a_byte),
    "nozzle has 2 values that are not finite": edited("nozzle", at((3, slice(0, 2)), math.nan)),
    "commanded has 1 values that are not finite": edited("commanded", at((5, 1), math.inf)),
    "fault = {'kind': 'travel', 'axis': 'q'": edited(
        "fault", lambda array: np.array(str(array).replace('"axis": "x"', '"axis": "q"'))
    ),
    "period is not an array of numbers or text": put("period", np.array(1e-3, ">f8")),
    "progress from 0 to": edited("progress", at(9, 0.0)),
}


@pytest.mark.parametrize("message", DAMAGES)
def test_what_a_record_must_have_is_named(place, content, message):
    place.write_bytes(sealed(archived(DAMAGES[message](members(content)))))
    with pytest.raises(InputError) as refused:
        Run.load(place)
    assert message.partition(": no")[0] in str(refused.value)
    assert "\n" not in str(refused.value)


def test_members_that_stand_there_twice_or_are_packed_in_another_way_are_refused(place, content):
    files = members(content)
    place.write_bytes(content)
    with warnings.catch_warnings(), zipfile.ZipFile(place, "a") as archive:
        warnings.simplefilter("ignore")
        archive.writestr("gap.npy", files["gap.npy"])
    with pytest.raises(InputError, match="members stand there twice"):
        Run.load(place)
    with zipfile.ZipFile(place, "w", zipfile.ZIP_BZIP2) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    with pytest.raises(InputError, match="is packed in another way"):
        Run.load(place)
