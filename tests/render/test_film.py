"""Films: frames, times, sizes, and files that are complete or absent."""

import dataclasses
import resource
from types import SimpleNamespace

import imageio.v2 as imageio
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from gantrysim import InputError
from gantrysim.render import Film, NoOpenGLError, Renderer, Take, film, save_video
from gantrysim.render.camera import Sight
from gantrysim.render.colours import scale_for
from gantrysim.render.fonts import MUTED, font
from gantrysim.render.panel import run_colours
from gantrysim.render.renderer import BEAD
from gantrysim.results.checks import Row
from gantrysim.results.colours import INK
from gantrysim.results.verdict import Verdict

from support.films import SHAPES, cut, shows, small_job
from support.soaked import suite_runs

SIZE = (300, 200)
PAIR = (480, 240)
CODED = 6.0  # mean difference of a picture that was coded and decoded again, of 255
PALETTE = 2.0  # and of one in 256 colours
FURTHEST = 40  # of a pixel of it, in its worst channel


@pytest.fixture(scope="module")
def run():
    """Without its job, and so without a verdict."""
    return small_job().run().replaced(job=None)


@pytest.fixture(scope="module")
def short(run):
    return cut(run, 800)


@pytest.fixture(scope="module")
def alone(xy, run):
    with Film([Take(xy, run, "one")], size=SIZE, colour="plain") as opened:
        yield opened


@pytest.fixture(scope="module")
def pair(xy, run, short):
    with Film([Take(xy, run, "long"), Take(xy, short, "short")], size=PAIR, colour="plain") as opened:
        yield opened


def decoded(file):
    with imageio.get_reader(file) as reader:
        return [np.asarray(frame) for frame in reader], reader.get_meta_data()


def of_gif(file):
    with Image.open(file) as gif:
        frames, durations = [], []
        for k in range(gif.n_frames):
            gif.seek(k)
            durations.append(gif.info["duration"])
            frames.append(np.asarray(gif.convert("RGB")))
        return frames, durations, gif.info.get("loop")


def apart(first, second):
    return np.abs(first.astype(float) - second).mean()


def test_the_picture_in_the_film_is_the_renderers_to_the_last_bit(xy, run, alone, tmp_path):
    (cell,) = alone.cells
    above = alone.panel.size[1]
    assert (cell.left, cell.top, cell.width) == (0, above, SIZE[0])
    assert cell.height + above == SIZE[1]
    alone.save_picture(tmp_path / "a.png", 0.7)
    picture = np.asarray(Image.open(tmp_path / "a.png"))
    assert picture.shape == (SIZE[1], SIZE[0], 3)
    with Renderer(xy, run, BEAD, (cell.width, cell.height)) as renderer:
        np.testing.assert_array_equal(cell.of(picture), renderer.frame(700))
    np.testing.assert_array_equal(picture[:above], alone.panel.picture(0.7))
    played = alone.frame(0.7, 4.0)[:above]
    np.testing.assert_array_equal(played, alone.panel.picture(0.7, 4.0))
    assert shows(played, "×4", alone.panel.font.size, INK)
    alone.save_picture(tmp_path / "b.png")
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "b.png")), alone.frame(run.time[-1]))


@given(st.floats(0.5, 200), st.floats(0.05, 50))
def test_frame_k_shows_the_time_k_speed_over_fps_and_the_last_the_end(alone, fps, speed):
    times = alone.times(fps, speed)
    np.testing.assert_allclose(times[:-1], np.arange(len(times) - 1) * speed / fps, rtol=1e-12)
    assert times[-1] == alone.end
    assert times[0] == 0
    steps = np.diff(times) * fps / speed
    assert steps.size == 0 or (steps.max() <= 1 + 1e-6 and steps.min() > 0)


def test_an_mp4_has_its_frames_its_rate_and_its_pictures(alone, run, tmp_path):
    seen = []
    count = alone.save(tmp_path / "a.mp4", fps=8, speed=1, progress=seen.append)
    frames, meta = decoded(tmp_path / "a.mp4")
    assert meta["fps"] == 8
    assert meta["codec"] == "h264"
    assert meta["pix_fmt"].startswith("yuv420p(tv, bt709")  # what browsers play, in colours that they cannot mistake
    assert len(frames) == count == int(np.ceil(run.time[-1] * 8)) + 1 + 8  # and the end card
    assert meta["duration"] == pytest.approx(count / 8, abs=0.01)
    assert seen == pytest.approx(np.arange(1, count - 7) / (count - 8))
    for k in (0, 5, count - 9):
        time = min(k / 8, run.time[-1])
        assert apart(frames[k], alone.frame(time, 1.0)) < CODED
    for card in frames[-8:]:
        assert apart(card, alone.end_card(1.0)) < CODED
    assert apart(frames[5], alone.frame(6 / 8, 1.0)) > apart(frames[5], alone.frame(5 / 8, 1.0))
    assert list(tmp_path.iterdir()) == [tmp_path / "a.mp4"]
    # the index stands in front of the frames
    content = (tmp_path / "a.mp4").read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")


@pytest.mark.parametrize(("fps", "duration"), suite_runs([(10, 100), (30, 30), (500, 20)], 0))
def test_a_gif_has_frame_times_in_hundredths_and_the_right_frames(alone, run, tmp_path, fps, duration):
    speed = {10: 2.0, 30: 8.0, 500: 10.0}[fps]
    count = alone.save(tmp_path / "a.gif", fps=fps, speed=speed)
    frames, durations, loop = of_gif(tmp_path / "a.gif")
    assert set(durations) == {duration}
    assert loop == 0
    cards = round(1e3 / duration)
    assert len(frames) == count == int(np.ceil(run.time[-1] / (speed * 1e-3 * duration) - 1e-9)) + 1 + cards
    for k in (0, 2, count - cards - 1):
        assert apart(frames[k], alone.frame(min(k * speed * 1e-3 * duration, alone.end), speed)) < PALETTE


@pytest.mark.soak
def test_a_gif_keeps_rare_colours(xy, run, tmp_path):
    with Film([Take(xy, run)], camera="overview", size=(420, 200), colour="width") as coloured:
        coloured.save(tmp_path / "a.gif", fps=2)
        frames, _, _ = of_gif(tmp_path / "a.gif")
        away = np.abs(frames[2].astype(int) - coloured.frame(1.0, 1.0)).max(axis=2)
    assert away.max() <= FURTHEST
    assert away.mean() < PALETTE


@pytest.mark.soak
def test_two_films_of_a_run_are_the_same_frames(xy, run, alone, tmp_path):
    alone.save(tmp_path / "a.mp4", fps=4)
    save_video(xy, run, tmp_path / "b.mp4", size=SIZE, fps=4.0, label="one", colour="plain")
    first, second = (decoded(tmp_path / name)[0] for name in ("a.mp4", "b.mp4"))
    assert len(first) == len(second) > 5
    np.testing.assert_array_equal(first, second)


def test_a_film_runs_in_real_time_or_faster_to_stay_below_a_minute(xy, run, alone, tmp_path):
    assert alone.save(tmp_path / "a.mp4", fps=2) == int(np.ceil(2 * run.time[-1])) + 1 + 2
    slow = dataclasses.replace(run, time=run.time * 90, period=run.period * 90)  # 130 s
    count = int(np.ceil(0.2 * slow.time[-1] / 3)) + 1 + 1
    assert save_video(xy, slow, tmp_path / "b.mp4", size=SIZE, fps=0.2) == count


def test_runs_side_by_side_are_at_the_same_time(xy, run, short, pair):
    first, second = pair.cells
    assert (first.top, first.width, first.height) == (second.top, second.width, second.height)
    assert first.left + first.width <= second.left
    assert second.left + second.width == PAIR[0]
    assert pair.end == run.time[-1]
    size = first.width, first.height
    framing = Sight(xy.model, xy, run, size[0] / size[1]).framing([short])
    with Renderer(xy, run, framing, size) as renderer, Renderer(xy, short, framing, size) as other:
        for time in (0.35, 0.7, 1.2):
            frame = pair.frame(time)
            tick = round(time / run.period)
            np.testing.assert_array_equal(first.of(frame), renderer.frame(tick))
            # the shorter run keeps its last picture
            np.testing.assert_array_equal(second.of(frame), other.frame(min(tick, len(short.time) - 1)))


def test_each_picture_is_headed_by_its_label_and_shows_when_it_has_ended(pair, short):
    letters = 10
    colours = run_colours(2)
    cells = pair.cells
    for time, over in ((0.5, False), (1.2, True)):
        frame = pair.frame(time)
        heads = [frame[pair.panel.size[1] : cell.top, cell.left : cell.left + cell.width] for cell in cells]
        for head, label, colour, other in zip(heads, ("long", "short"), colours, colours[::-1], strict=True):
            assert shows(head, label, letters, colour, bold=True)
            assert not shows(head, label, letters, other, bold=True)
        assert shows(heads[1], f"ended at {short.time[-1]:.2f} s", letters, MUTED) is over
        assert not shows(heads[0], f"ended at {short.time[-1]:.2f} s", letters, MUTED)
        assert shows(frame[: pair.panel.size[1]], f"{time:.2f} s", pair.panel.font.size, INK)


@pytest.mark.soak
def test_four_runs_are_drawn_independently_and_repeatably(xy, run, short):
    bare = dataclasses.replace(run, flow=np.zeros(len(run.time)))
    takes = [Take(xy, one, name) for one, name in ((run, "a"), (short, "b"), (bare, "c"), (cut(run, 400), "d"))]
    with Film(takes, size=(400, 300), colour="error") as four:
        frames = [four.frame(time) for time in (1.0, 0.2, 1.0)]
        scale = scale_for("error", [take.run for take in takes])
        cells = four.cells
    np.testing.assert_array_equal(frames[0], frames[2])
    assert not np.array_equal(frames[0], frames[1])
    assert len({(cell.left, cell.top) for cell in cells}) == 4
    framing = Sight(xy.model, xy, run, cells[0].width / cells[0].height).framing([take.run for take in takes[1:]])
    for cell, take in zip(cells, takes, strict=True):
        size = (cell.width, cell.height)
        with Renderer(xy, take.run, framing, size, colour="error", scale=scale) as renderer:
            tick = min(1000, len(take.run.time) - 1)
            np.testing.assert_array_equal(cell.of(frames[0]), renderer.frame(tick))


class BrokenError(Exception):
    """Of the caller."""


@pytest.mark.parametrize("name", suite_runs(["a.mp4", "a.gif"], 1))
@pytest.mark.parametrize("error", [BrokenError, KeyboardInterrupt])
def test_an_interrupted_film_leaves_the_earlier_one_and_nothing_else(alone, tmp_path, error, name):
    (tmp_path / name).write_bytes(b"earlier")

    def interrupt(share):
        assert len(list(tmp_path.iterdir())) == 2
        if share > 0.4:
            raise error

    with pytest.raises(error):
        alone.save(tmp_path / name, fps=5, progress=interrupt)
    assert (tmp_path / name).read_bytes() == b"earlier"
    assert list(tmp_path.iterdir()) == [tmp_path / name]


@pytest.mark.parametrize(
    ("script", "most"),
    [
        ("exit 1", 0),
        ("cat > $0.all", 0),
        ('head -c 400000 | "$REAL" "$@"', 2),  # as when it is killed: of frames of 180 kB
    ],
)
@pytest.mark.parametrize("name", suite_runs(["a.mp4", "a.gif"], 0))
def test_a_failing_encoder_leaves_no_partial_film(alone, tmp_path, monkeypatch, name, script, most):
    import imageio_ffmpeg

    monkeypatch.setenv("REAL", imageio_ffmpeg.get_ffmpeg_exe())
    encoder = tmp_path / "encoder"
    encoder.write_text(f'#!/bin/sh\ncase "$*" in *rawvideo*) {script};; *) exec "$REAL" "$@";; esac\n')
    encoder.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(encoder))
    told = rf"{name}: cannot be written: the encoder wrote [0-{most}] of \d+ frames; \d+\.\d MB are free$"
    with pytest.raises(InputError, match=told):
        alone.save(tmp_path / name, fps=4)
    assert [item.name for item in tmp_path.iterdir() if not item.name.startswith("encoder")] == []


@pytest.mark.skipif(not hasattr(resource, "RLIMIT_FSIZE"), reason="asks for limits of files")
def test_a_film_cut_short_by_a_few_bytes_is_told(alone, tmp_path):
    """A limit on the size of files stands for a full disk: at the end the index is moved in front of the frames."""
    alone.save(tmp_path / "a.mp4", fps=4)
    content = (tmp_path / "a.mp4").read_bytes()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    for missing in (1, 100, 2000):
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(content) - missing, before[1]))
        try:
            with pytest.raises(InputError, match=r"b\.mp4: cannot be written: the encoder wrote \d+ of"):
                alone.save(tmp_path / "b.mp4", fps=4)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [item.name for item in tmp_path.iterdir()] == ["a.mp4"]


def test_bad_films_are_refused(xy, run, alone, tmp_path):
    take = Take(xy, run)
    for wrong, text in (
        ({"takes": [take] * 3}, "number of runs = 3: must be 1, 2 or 4"),
        ({"takes": []}, "number of runs = 0: must be 1, 2 or 4"),
        ({"size": (0, 100)}, "width of the film = 0: must be at least 1"),
        ({"size": (300.5, 200)}, "width of the film = 300.5: must be a whole number"),
        ({"size": (300, 90), "colour": "plain"}, "height of the film = 90: must be at least 106, for the pictures"),
        (
            {"takes": [take] * 4, "size": (400, 200)},
            r"height of the film = 200: must be at least \d+, for the pictures",
        ),
        ({"size": (100, 200)}, r"width of the film = 100: must be at least \d+, for readout and error strip"),
        ({"camera": "topp"}, "unknown camera 'topp': did you mean top"),
        ({"colour": "eror"}, "unknown colour 'eror': did you mean error"),
    ):
        with pytest.raises(InputError, match=text):
            Film(**{"takes": [take], "size": SIZE, **wrong})
    for name, wrong, text in (
        ("a.avi", {}, "suffix = '.avi': must be .mp4 or .gif"),
        ("a", {}, "suffix = '': must be .mp4 or .gif"),
        ("no/a.mp4", {}, "no such folder .*/no"),
        ("a.mp4", {"fps": 0}, "frames per second = 0 1/s: must be greater than 0"),
        ("a.gif", {"fps": -1}, "frames per second = -1 1/s: must be greater than 0"),
        ("a.mp4", {"fps": float("nan")}, "frames per second = nan 1/s: must be finite"),
        ("a.mp4", {"speed": 0}, "speed of the film = 0: must be greater than 0"),
        (
            "a.mp4",
            {"fps": 1e9},
            r"number of frames = 1.\d+e\+09, with 1e\+09 frames per second and speed 1: must be at most 100000",
        ),
        ("a.gif", {"speed": 1e-9}, r"with 25 frames per second and speed 1e-09: must be at most 100000: use fewer"),
        ("a.mp4", {"speed": 1e-320}, "number of frames = inf, .* must be at most 100000"),
    ):
        with pytest.raises(InputError, match=text):
            alone.save(tmp_path / name, **wrong)
    (tmp_path / "folder.png").mkdir()
    for name, at, text in (
        ("a.mp4", 0.5, "suffix = '.mp4': must be .png"),
        ("folder.png", 0.5, "folder.png: is a folder"),
        ("a.png", 9.0, f"time = 9 s: must be from 0 s to the end of the run, {run.time[-1]:g} s"),
        ("a.png", -0.1, "time = -0.1 s: must be from 0 s"),
        ("a.png", float("nan"), "time = nan s: must be finite"),
    ):
        with pytest.raises(InputError, match=text):
            alone.save_picture(tmp_path / name, at)
    with Film([take], size=(301, 201)) as odd:
        with pytest.raises(InputError, match="size of the video = 301 x 201: must be even numbers of pixels"):
            odd.save(tmp_path / "a.mp4")
        assert odd.save(tmp_path / "odd.gif", fps=2) > 2
    assert of_gif(tmp_path / "odd.gif")[0][0].shape == (201, 301, 3)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["folder.png", "odd.gif"]


class Unopened:
    """Stands for a renderer where only places matter."""

    framing = None

    def __init__(self, *_):
        self.scene = SimpleNamespace()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


@pytest.mark.parametrize("count", suite_runs([1, 2, 4], 2))
@pytest.mark.parametrize("colour", suite_runs(["plain", "error"], 1))
def test_the_pictures_of_a_film_of_any_shape_do_not_overlap(xy, run, monkeypatch, count, colour):
    monkeypatch.setattr(film, "Renderer", Unopened)
    scale = scale_for(colour, [run])
    monkeypatch.setattr(film, "scale_for", lambda *_: scale)
    takes = [Take(xy, run, f"run {k}") for k in range(count)]
    for size in SHAPES:
        opened = Film(takes, size=size, colour=colour)
        taken = np.zeros(size[::-1], int)
        taken[: opened.panel.size[1]] += 1
        for cell in opened.cells:
            assert cell.height >= 0.2 * size[1]
            assert cell.width >= 0.45 * size[0]
            cell.of(taken)[:] += 1
        assert taken.max() == 1
        assert taken.mean() > 0.7
        assert opened.cells[0].of(taken).sum() == opened.cells[0].width * opened.cells[0].height
    if count == 4:
        films = [Film(takes, size=size) for size in ((720, 1280), (1280, 720))]
        heads = [opened.cells[0].top - opened.panel.size[1] for opened in films]
        assert heads[0] > 1.2 * heads[1]  # two lines of readout, and letters about as large
    two = Film(takes, size=(400, 700), colour=colour).cells
    assert len({cell.left for cell in two}) == (2 if count == 4 else 1)


@pytest.mark.parametrize("count", suite_runs([1, 2, 4], 1))
def test_the_least_height_in_the_error_is_accepted(xy, run, monkeypatch, count):
    monkeypatch.setattr(film, "Renderer", Unopened)
    takes = [Take(xy, run)] * count
    for width in (240, 400, 1000):
        with pytest.raises(InputError, match="for the pictures") as refused:
            Film(takes, size=(width, 60))
        least = int(str(refused.value).split("at least ")[1].split(",")[0])
        assert Film(takes, size=(width, least)).cells[0].height == 40
        with pytest.raises(InputError, match=f"height of the film = {least - 1}: must be at least {least}, "):
            Film(takes, size=(width, least - 1))


def test_a_read_only_folder_is_named(alone, tmp_path, monkeypatch):
    def refuse(*_, prefix, dir):
        raise PermissionError(13, "Permission denied", f"{dir}/{prefix}abc")

    monkeypatch.setattr("tempfile.mkdtemp", refuse)
    for save, name in ((alone.save, "a.mp4"), (alone.save_picture, "a.png")):
        with pytest.raises(InputError, match=f"{name}: cannot be written: Permission denied"):
            save(tmp_path / name)


def test_without_opengl_nothing_is_left_open(xy, run, monkeypatch):
    opened = []
    monkeypatch.setattr(film.Renderer, "close", lambda self: opened.remove(self))

    def limited(self, *_, **__):
        if len(opened) == 2:
            raise NoOpenGLError("no more")
        opened.append(self)

    monkeypatch.setattr(film.Renderer, "__init__", limited)
    with pytest.raises(NoOpenGLError, match="no more"):
        Film([Take(xy, run)] * 4, size=(400, 300))
    assert not opened


def test_frames_are_not_kept_in_memory(alone, tmp_path):
    import gc
    import weakref

    kept, speeds = [], []
    plain = type(alone).frame

    class Tracked(np.ndarray):
        pass

    def frame(self, *arguments):
        picture = plain(self, *arguments).view(Tracked)
        kept.append(weakref.ref(picture))
        speeds.append(arguments[1])
        return picture

    type(alone).frame = frame
    gc.freeze()  # what is there before is not looked at again with every frame
    try:
        most = []

        def count(_share):
            gc.collect()
            most.append(sum(one() is not None for one in kept))

        alone.save(tmp_path / "a.mp4", fps=10, speed=1.5, progress=count)
    finally:
        gc.unfreeze()
        type(alone).frame = plain
    assert len(most) >= 10
    assert max(most) <= 2
    assert set(speeds) == {1.5}  # which every frame says


def test_a_machine_without_cameras_or_label_is_filmed_by_its_name(rigid, run):
    machine = rigid()
    with Film([Take(machine, run)], size=(480, 360)) as opened:
        frame = opened.frame(0.5)
    assert shows(frame[: opened.panel.size[1]], machine.name, opened.panel.font.size, INK, bold=True)


def judged_by(**states):
    return Verdict(
        tuple(Row(name, state=states.get(name, "pass")) for name in ("path", "glue", "stability", "machine"))
    )


@pytest.mark.soak
@pytest.mark.parametrize(
    "verdict",
    suite_runs(
        [
            judged_by(path="fail", glue="fail"),
            judged_by(),
            Verdict((Row("path"), Row("glue")), fault=30 * "stability, "),
        ],
        2,
    ),
    ids=lambda verdict: verdict.state,
)
def test_a_verdict_stands_above_its_picture_and_changes_nothing_else(xy, run, short, verdict):
    size = (480, 360)
    takes = [Take(xy, run, "long", verdict=verdict), Take(xy, short, "short")]
    with Film(takes, size=size) as judged, Film([Take(xy, run, "long"), takes[1]], size=size) as plain:
        picture, bare = (film.frame(film.end) for film in (judged, plain))
        letters = judged.panel.font.size
        cells = judged.cells
    changed = np.argwhere((picture != bare).any(axis=2))
    first = changed.min(axis=0)
    last = changed.max(axis=0)
    assert cells[0].top <= first[0] <= last[0] < cells[0].top + 2 * letters
    assert cells[0].left <= first[1] <= last[1] < cells[0].left + cells[0].width
    text = font(letters, True).shortened(verdict.headline, cells[0].width - 2 * font(letters, True).margin)
    assert text.startswith(verdict.headline[:4])
    assert shows(cells[0].of(picture), text, letters, INK, bold=True)
