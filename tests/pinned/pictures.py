"""Films and viewer: cameras, scales, headers, panels and strips, times of frames, and files as ffmpeg reads them."""

import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
from imageio_ffmpeg import count_frames_and_secs, read_frames
from PIL import Image
from pinned.runs import JOBS, digits

from gantrysim import Fault, InputError, Job
from gantrysim.render.antialiasing import smoothed_picture
from gantrysim.render.camera import Flight, Framing, Sight, View
from gantrysim.render.colours import chosen_colour, scale_for
from gantrysim.render.encoding import film_rate, film_writer
from gantrysim.render.film import Film, Take, end_card
from gantrysim.render.fonts import PAPER, font, rgb
from gantrysim.render.header import Caption, differences, headers
from gantrysim.render.panel import Legend, Panel, colour_bar, run_colours
from gantrysim.render.renderer import Inset, checked_size
from gantrysim.render.scene import GLOSS, Scene, mesh_part
from gantrysim.render.strip import Strip, axis_ticks, round_step
from gantrysim.render.telemetry import Telemetry
from gantrysim.render.view.clock import Clock, Pace
from gantrysim.render.view.texts import Chart, ViewState, lines, moment_texts, plain
from gantrysim.render.workpiece import workpiece

from support.remedies import SIDES, lines_job
from support.viewer_jobs import climbing_job

SHAPE = 16 / 9
# most of the travel
WIDE = """G21 G17 G90 G94 G64 P0.02
G0 X-140 Y-140
M62 P0
G1 X140 F24000
G1 Y140
G1 X-140
M63 P0
M2
"""
RUNS = {
    "fixed flow": JOBS["fixed flow"],
    "soft": JOBS["soft"],
    "wide": lambda: lines_job(WIDE),
    "climbing": climbing_job,
}


@cache
def run_of(name):
    return RUNS[name]().run()


@cache
def faulted():
    """A run that a fault has ended after its second corner."""
    run = run_of("fixed flow")
    fault = Fault("following error", "x", 1.25, 5.02, 5.0, "mm", "the group stops with its greatest deceleration")
    ticks = slice(0, 1251)
    names = [name for name, value in vars(run).items() if isinstance(value, np.ndarray) and len(value) == len(run.time)]
    return replace(run, **{name: getattr(run, name)[ticks] for name in names}, fault=fault)


@cache
def telemetry_of(name):
    return Telemetry(faulted() if name == "faulted" else run_of(name))


@cache
def scene_of(name, colour="plain", in_pieces=False):
    run = run_of(name)
    return Scene(run.job.built_machine, run, colour=colour, in_pieces=in_pieces)


def ink(picture, paper=None):
    """Size of a picture; number, middle and edges of its pixels that are not paper; and sums of all colours by rows."""
    paper = rgb(PAPER) if paper is None else paper
    rows, columns = np.nonzero(np.any(picture != paper, axis=2))
    weights = 1.0 + np.arange(picture.shape[0])
    # apart from one another, as numbers of a list are compared by the largest of them
    answer = {
        "size": picture.shape[:2],
        "pixels": rows.size,
        "rows": weights @ picture.mean(axis=1) / weights.sum(),
    }
    if rows.size:
        answer["middle"] = [float(rows.mean()), float(columns.mean())]
        answer["edges"] = [rows.min(), rows.max(), columns.min(), columns.max()]
    return answer


# cameras


def framing_answer(*names):
    runs = [run_of(name) for name in names]
    framing = Framing.of(runs, 65.0)
    places = framing.in_picture(SHAPE)
    return {
        "centre": framing.centre,
        "points": [len(framing.points), *framing.points.mean(axis=0)],
        "axes": framing.axes,
        "elevation": framing.elevation,
        "distances": [framing.distance(shape) for shape in (0.5, 1.0, SHAPE, 3.0)],
        "margin": framing.distance(SHAPE, 1.0),
        "place": framing.position(SHAPE),
        "in picture": [*places.min(axis=0), *places.max(axis=0), *places.mean(axis=0)],
    }


def sight_answer(name):
    run = run_of(name)
    machine = run.job.built_machine
    sight = Sight(machine.model, machine, run, SHAPE)
    framings = [Framing.of([run], azimuth) for azimuth in (20.0, 110.0, 200.0, 290.0)]
    best = sight.framing()
    names = [machine.model.body(machine.model.geom_bodyid[geom]).name for geom in sight.hiding(framings[0])]
    return {
        "hidden": [sight.hidden_share(framing) for framing in framings],
        "hiding": {body: names.count(body) for body in names},
        "best": [best.azimuth, best.elevation, sight.hidden_share(best)],
        "best of two": sight.framing([run_of("fixed flow")]).azimuth,
    }


def seen(view):
    return [*view.centre, view.distance, view.azimuth, view.elevation, view.field]


def flight_answer(name):
    run = run_of(name)
    scene = Scene(run.job.built_machine, run)
    flight = Flight(scene, run.job.built_machine, SHAPE)
    views = {}
    for share in (0.0, 0.3, 1.0):
        views[f"{share:g}"] = [*seen(flight.view(share)), float(scene.model.geom_rgba[:, 3].sum())]
    scene.pose(len(run.time) // 2)
    camera = mujoco.MjvCamera()
    flight.view(1.0).set(camera, scene.model)
    return views | {"later": [*camera.lookat, camera.distance, camera.azimuth, scene.model.vis.global_.fovy]}


def views_answer():
    first = View(np.array([0.0, 0.1, 0.2]), 2.0, 170.0, -20.0, 30.0)
    second = View(np.array([0.4, 0.0, 0.1]), 0.5, -160.0, -50.0, 45.0)
    return [seen(first.towards(second, share)) for share in (0.0, 0.25, 0.5, 1.0)] + [seen(second.towards(first, 0.25))]


def inset_answer(name):
    run = run_of(name)
    scene = scene_of(name)
    answer = []
    for azimuth in (20.0, 110.0, 200.0, 290.0):
        for size in ((1280, 720), (480, 270), (300, 300)):
            inset = Inset.of(scene, Framing.of([run], azimuth), size)
            place = None if inset is None else inset.viewport
            answer.append(None if place is None else [place.left, place.bottom, place.width, place.height])
    picture = np.zeros((90, 160, 3), np.uint8)
    Inset(scene, (1, 1), (160, 90), 0.34).frame(picture)
    return [
        *answer,
        [int((picture == 230).all(axis=2).sum()), *map(int, np.argwhere(picture[..., 0])[[0, -1]].ravel())],
    ]


# the scene


def scene_answer(name, colour):
    run = run_of(name)
    scene = Scene(run.job.built_machine, run, colour=colour, in_pieces=colour != "plain")
    model = scene.model
    before = [float(model.mat_specular.sum()), float(model.mat_emission.sum())]
    scene.make_wet()
    needle = model.geom("needle").id
    poses = []
    drawn = mujoco.MjvScene(model, maxgeom=10)
    for tick in (0, len(run.time) // 3, len(run.time) - 1):
        scene.pose(tick)
        uploads = scene.draw_bead()
        vertices = mesh_part(model, scene.mesh, "vert").astype(float)
        drawn.ngeom = 0
        scene.decorate(drawn)
        drop = drawn.geoms[0] if drawn.ngeom else None
        texture = mesh_part(model, scene.mesh, "texcoord").astype(float)
        poses.append(
            {
                "uploads": len(uploads),
                "shown": int((model.geom_group[scene.bead_geoms] == 0).sum()),
                "vertices": [*vertices.mean(axis=0), *vertices.std(axis=0)],
                "texture": [*texture.mean(axis=0), *texture.max(axis=0)] if len(texture) else [],
                "drop": [] if drop is None else [*drop.pos, *drop.size, *drop.rgba, drop.emission, drop.shininess],
            }
        )
    return {
        "extent": [float(model.stat.extent), *model.stat.center],
        "pieces": len(scene.bead_geoms),
        "needle": [*model.geom_size[needle], *model.geom_pos[needle]],
        "materials": [*before, float(model.mat_specular.sum()), float(model.mat_emission.sum())],
        "lights": [int(model.light_active.sum()), *model.light_specular[model.light(GLOSS).id]],
        "poses": poses,
    }


def work_answer(name):
    run = run_of(name)
    piece = workpiece(run, None, 0.0)
    if piece is None:
        return None
    corners = piece.vertices[piece.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    low = workpiece(run, None, 5.0)
    return {
        "counts": [len(piece.vertices), len(piece.faces)],
        "box": [*piece.vertices.min(axis=0), *piece.vertices.max(axis=0)],
        "area": float(np.linalg.norm(normals, axis=1).sum() / 2),
        "volume": float(np.sum(corners[:, 0] * normals) / 6),
        "on another level": [len(low.faces), float(low.vertices[:, 2].min())],
    }


# colours


def scales_answer(name):
    run = run_of(name)
    answer = {"chosen": [chosen_colour(colour, [run]) for colour in (None, "verdict", "error")]}
    for colour in ("width", "error"):
        scale = scale_for(colour, [run], None, run.known_verdict)
        values = np.linspace(scale.low, scale.high, 7)
        answer[colour] = {
            "title": f"{scale.title} [{scale.unit}], {scale.short_title}",
            "ends": [scale.low, scale.high, scale.below, scale.above],
            "labels": scale.labels(),
            "places": scale.label_places,
            "shares": scale.share(values),
            "table": scale.table[[0, 64, 128, 200, 255]],
            "bar": ink(colour_bar(scale, 200)),
            "legends": [Legend(scale, font(size), narrow).width for size in (9, 20) for narrow in (False, True)],
            "legend": ink(Legend(scale, font(14), True).picture(150)),
        }
    bare = replace(run, job=None)
    scale = scale_for("error", [bare])
    return answer | {"without a job": [scale.low, scale.high, scale.below, scale.above, *scale.labels()]}


# what stands beside the pictures


def telemetry_answer(name):
    telemetry = telemetry_of(name)
    end = len(telemetry.time) - 1
    ticks = (0, 1, end // 2, end - 1, end)
    times = (0.0, 0.5, float(telemetry.time[-1]), float(telemetry.time[-1]) + 0.0006, 99.0)
    return {
        "speeds": [telemetry.speed(tick) for tick in ticks],
        "errors": [telemetry.error_text(tick) for tick in ticks],
        "rms / max": [telemetry.rms_max_text(tick) for tick in ticks],
        "states": [[telemetry.tick(time), telemetry.has_ended(time), telemetry.has_faulted(time)] for time in times],
    }


def strip_answer(names, size, letters, head=0):
    runs = [telemetry_of(name) for name in names]
    strip = Strip(runs, run_colours(len(runs)), size, font(letters), head)
    return {
        **{name: getattr(strip, name) for name in ("end", "top", "left", "right", "above", "bottom")},
        "ticks": [strip.time_ticks, strip.error_ticks],
        "places": [strip.column(0.3), strip.column(99.0), strip.row(0.5 * strip.top)],
        "pictures": [ink(strip.picture(time)) for time in (0.0, 0.6, 99.0)],
    }


FRAMES = ((1280, 720), (640, 360), (360, 640), (240, 240), (150, 300), (1000, 200))


def panel_answer(names):
    runs = [telemetry_of(name) for name in names]
    scale = scale_for("error", [run.run for run in runs])
    answer = {}
    for frame in FRAMES:
        for scaled in (True, False):
            try:
                panel = Panel(runs, frame, "a job with a long name", scale if scaled else None)
            except InputError as error:
                answer[f"{frame}, {scaled}"] = str(error)
                continue
            answer[f"{frame}, {scaled}"] = [
                *panel.size,
                panel.font.size,
                panel.strip_left,
                panel.strip_above,
                panel.legend_left,
                *panel.strip.size,
            ]
    panel = Panel(runs, (640, 360), "a job with a long name", scale)
    return answer | {"pictures": [ink(panel.picture(*moment)) for moment in ((0.5, 2.0), (0.5,), (99.0, 0.125))]}


def headers_answer(width, largest, line_count):
    runs = [telemetry_of(name) for name in ("fixed flow", "soft", "faulted")]
    labels = ["loop_period = 1 s, flow = 200 mm³/s", "loop_period = 0.01 s, flow = 200 mm³/s", "a fault"]
    made = headers(runs, labels, run_colours(4)[:3], width, largest, line_count)
    return [
        [[*header.size, header.font.size, header.room], *(ink(header.picture(t)) for t in (0.6, 99.0))]
        for header in made
    ]


def caption_answer(name):
    verdict = run_of(name).known_verdict
    answer = []
    for width, largest in ((640, 16), (200, 16), (60, 9)):
        caption = Caption(verdict, width, largest)
        picture = np.full((120, width, 3), 255, np.uint8)
        caption.write(picture)
        marked = np.full((120, width, 3), 255, np.uint8)
        caption.write(marked, (0.9 * width, 15.0), [[(5.0, 60.0), (40.0, 90.0), (50.0, 80.0)], [(1.0, 1.0)]])
        answer += [ink(picture), ink(marked)]
    place = Caption(verdict, 640, 16).place
    return [*answer, None if place is None else place.brief]


def card_answer():
    names = ("fixed flow", "soft", "faulted")
    runs = [telemetry_of(name) for name in names]
    verdicts = [run_of("fixed flow").known_verdict, None, run_of("soft").known_verdict]
    picture = np.full((180, 640, 3), 200, np.uint8)
    card = end_card(picture, runs, list(names), verdicts)
    return [
        ink(card, card[0, 0]),
        *(card[row, 5].tolist() for row in (0, 90)),
        ink(end_card(picture, runs[:1], ["one"], verdicts[:1]), card[0, 0]),
    ]


def labels_answer():
    jobs = [
        lines_job(SIDES, servo={"frequency": frequency, "damping": 0.9}, dispenser={"flow": flow}, bead={"gap": gap})
        for frequency, flow, gap in ((8.0, 100.0, 0.4), (9.5, 100.0, 0.5))
    ]
    texts = [lines_job(SIDES), lines_job(SIDES.replace("X40", "X41")), Job.load("an225")]
    fonts = font(12)
    return {
        "two": differences(jobs),
        "same": differences(jobs[:1] * 2),
        "text": differences(texts[:2]),
        "machines": differences(texts[::2]),
        "shortened": [fonts.shortened("a label that is long", width) for width in (500, 100, 60, 8)],
        "distinct": [
            fonts.distinct(["speed 10 mm/s, slow", "speed 20 mm/s, slow"], width) for width in (200, 100, 60, 30)
        ],
        "wrapped": fonts.wrapped("words of a text in lines of some length", 90),
        "colours": [run_colours(count) for count in (1, 2, 4)],
    }


def ticks_answer():
    return {
        "steps": [round_step(least) for least in (1.0, 1.01, 2.0, 2.1, 4.99, 5.01, 0.03, 700.0)],
        "ticks": [axis_ticks(top, most) for top, most in ((10.0, 5.0), (9.9, 5.0), (0.37, 3.2), (1.0, 0.5))],
    }


# files


def frames_of(size, count):
    """Frames of one colour each, with a corner in another."""
    frames = []
    for k in range(count):
        frame = np.full((size[1], size[0], 3), (40 * k, 200 - 30 * k, 90), np.uint8)
        frame[: size[1] // 2, : size[0] // 2] = 250
        frames.append(frame)
    return frames


def file_answer(name, fps, size, count):
    """What ffmpeg reads of a film: size, rate, frames, time, and colours at two places of the last frame."""
    frames = frames_of(size, count)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        rate = film_rate(file, fps)
        with film_writer(file, rate, size, lambda: frames) as append:
            for frame in frames:
                append(frame)
        reader = read_frames(str(file))
        meta = next(reader)
        decoded = [np.frombuffer(data, np.uint8).reshape(*meta["size"][::-1], 3) for data in reader]
        loops = Image.open(file).info.get("loop") if file.suffix == ".gif" else None
        found = {key: meta[key] for key in ("size", "fps", "codec")}
        counted = count_frames_and_secs(file)
    last = decoded[-1].astype(int)
    places = [last[3 * size[1] // 4, 3 * size[0] // 4], last[size[1] // 4, size[0] // 4]]
    # a coder may miss a colour by some units
    return {
        "rate": rate,
        **found,
        "counted": counted,
        "loops": loops,
        "colours": [(8 * np.round(p / 8)) for p in places],
    }


def rates_answer():
    answer = []
    for name, fps in (
        ("a.gif", 25.0),
        ("a.gif", 30.0),
        ("a.gif", 90.0),
        ("a.gif", 1e-4),
        ("a.MP4", 30.0),
        ("a.mp4", 0.0),
    ):
        answer.append(outcome_of(film_rate, Path(name), fps))
    sizes = ((1, 1), (8192, 8192), (8193, 10), (10, 0), (10.5, 10))
    files = ("a.avi", "/nowhere/a.mp4", "/tmp.mp4", "/tmp/a.png")
    return [
        *answer,
        *(outcome_of(film_rate, Path(file), 25.0) for file in files),
        *(outcome_of(checked_size, "film", size) for size in sizes),
    ]


def outcome_of(function, *arguments):
    try:
        return function(*arguments)
    except InputError as error:
        return str(error)


def film_answer():
    """Times of the frames and places of the pictures of films of one and two runs."""
    run = run_of("fixed flow")
    machine = run.job.built_machine
    answer = {}
    with Film([Take(machine, run)], size=(240, 180)) as film:
        times = film.times(5.0, 0.5)
        answer["one"] = {
            "cells": film.cells,
            "end": film.end,
            "times": [len(times), *times[:3], *times[-2:]],
            "errors": [outcome_of(film.times, *numbers) for numbers in ((0.0, 1.0), (25.0, 0.0), (25.0, 1e-5))],
            "too late": outcome_of(film.frame, 99.0),
        }
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "film.mp4"
            shares = []
            frames = film.save(file, fps=2.0, speed=1.5, progress=shares.append)
            meta = next(read_frames(str(file)))
            answer["saved"] = [frames, shares, *meta["size"], meta["fps"], *count_frames_and_secs(file)]
    takes = [Take(machine, run, "first"), Take(machine, faulted(), "second")]
    for size in ((480, 240), (240, 480)):
        with Film(takes, size=size) as film:
            answer[f"two, {size}"] = [[*cell] for cell in film.cells]
    answer["counts"] = [outcome_of(Film, takes[:1] * count) for count in (0, 3)]
    answer["low"] = outcome_of(lambda: Film(takes, size=(480, 120)))
    return answer


def smooth_answer():
    rows, columns = np.mgrid[:24, :32]
    picture = np.where((columns > 0.7 * rows + 6)[..., None], (230, 40, 90), (20, 60, 200)).astype(np.uint8)
    faint = np.where((columns > 15)[..., None], 11, 10).astype(np.uint8) * np.ones(3, np.uint8)
    smooth = smoothed_picture(picture)
    return [
        int((smooth != picture).any(axis=2).sum()),
        smooth.astype(float).mean(axis=(0, 1)),
        smooth[12, 12:18],
        int((smoothed_picture(faint) != faint).sum()),
    ]


# the viewer


def clock_answer():
    clock = Clock(2.0, 5.0, since=10.0)
    answer = {
        "running": [clock.at(now) for now in (9.0, 10.0, 11.0, 99.0)],
        "toggled": [vars(clock.toggled(11.0)), vars(clock.toggled(11.0).toggled(12.0))],
        "moved": [vars(clock.moved(moment, 11.0)) for moment in (-1.0, 3.0, 9.0)],
        "scaled": [vars(clock.scaled(factor, 11.0)) for factor in (2.0, 1e6, 1e-9)],
        "paused": [
            Clock(moment=3.0).at(99.0),
            vars(Clock(moment=3.0).scaled(2.0, 7.0)),
            Clock(moment=9.0, end=4.0).at(0.0),
        ],
    }
    pace = Pace()
    answer["pace"] = []
    for now in (0.0, 0.4, 0.9, 1.0, 1.5, 2.6, 2.7):
        pace.note(now, 3 * now if now < 2 else 4 * now)
        answer["pace"].append(pace.factor)
    return answer


def texts_answer():
    telemetry = telemetry_of("fixed flow")
    fault = telemetry_of("faulted").run.fault
    answer = {}
    for name, live, over, tick, push, pace, keys, paused, error in (
        ("start", False, False, 0, 0.0, None, True, False, None),
        ("slow", True, False, 400, 9.94, 1.7, True, False, None),
        ("enough", True, False, 700, 12.3, 1.8, False, False, None),
        ("paused", False, False, 700, 0.0, 0.1, True, True, None),
        ("ended", True, True, 900, 0.0, 0.1, False, False, fault),
    ):
        source = SimpleNamespace(live=live, over=over, tick=tick, until=1.5, fault=error)
        clock = Clock(2.0, since=None if paused else 0.0)
        texts = moment_texts("job – µ", source, telemetry, ViewState(clock, pace, push, keys))
        answer[name] = [[" | ".join(row) for row in rows] for rows in texts]
    return answer | {"plain": plain("5 µm · 3 mm² × 2 – ü °")}


def chart_answer():
    telemetry = telemetry_of("fixed flow")
    answer = []
    for end, until in ((2, 0.0), (300, 1.5), (1200, 0.5), (1200, 70.0)):
        chart = Chart()
        chart.draw(telemetry.time[:end], telemetry.error[:end], until)
        figure = chart.figure
        counts = figure.linepnt[figure.linepnt > 0]
        answer.append([*figure.range.ravel(), *figure.gridsize, figure.xformat, figure.yformat, *counts])
    value = np.where(np.arange(900) % 10 == 0, np.nan, np.sin(np.arange(900.0)))
    split = [lines(np.arange(900.0), value, points, most) for points, most in ((100, 10), (100, 99), (5000, 99))]
    answer.append([[len(parts), sum(len(time) for time, _ in parts)] for parts in split])
    figure = Chart().figure
    return [
        *answer,
        [figure.title, figure.xlabel, *figure.figurergba, *figure.panergba, *figure.gridrgb, figure.linewidth],
    ]


CASES = {
    "framing": lambda: framing_answer("fixed flow"),
    "framing, wide": lambda: framing_answer("wide"),
    "framing, climbing": lambda: framing_answer("climbing"),
    "framing of two": lambda: framing_answer("fixed flow", "climbing"),
    "views": views_answer,
}
CASES |= {f"sight, {name}": lambda name=name: sight_answer(name) for name in ("climbing", "wide")}
CASES |= {f"flight, {name}": lambda name=name: flight_answer(name) for name in ("climbing", "wide")}
CASES |= {f"inset, {name}": lambda name=name: inset_answer(name) for name in ("fixed flow", "climbing")}
CASES |= {
    "scene, plain": lambda: scene_answer("fixed flow", "plain"),
    "scene, width": lambda: scene_answer("fixed flow", "width"),
    "scene, climbing": lambda: scene_answer("climbing", "error"),
}
CASES |= {f"work, {name}": lambda name=name: work_answer(name) for name in ("fixed flow", "climbing")}
CASES |= {f"scales, {name}": lambda name=name: scales_answer(name) for name in ("fixed flow", "soft")}
CASES |= {f"telemetry, {name}": lambda name=name: telemetry_answer(name) for name in ("fixed flow", "faulted")}
CASES |= {
    "strip": lambda: strip_answer(["fixed flow"], (400, 90), 12),
    "strip of two": lambda: strip_answer(["fixed flow", "soft", "faulted"], (250, 120), 16, 40),
    # in letters so large that the margins are whole pixels apart
    "strip, large": lambda: strip_answer(["soft"], (1400, 500), 80),
    "panel": lambda: panel_answer(["fixed flow"]),
    "panel of two": lambda: panel_answer(["fixed flow", "faulted"]),
    "headers": lambda: headers_answer(400, 16, 1),
    "headers, narrow": lambda: headers_answer(180, 14, 2),
    "headers, too narrow": lambda: headers_answer(90, 14, 1),
    "captions": lambda: caption_answer("fixed flow"),
    "captions, of a path": lambda: caption_answer("soft"),
    "card": card_answer,
    "labels": labels_answer,
    "ticks": ticks_answer,
    "film": film_answer,
    "mp4": lambda: file_answer("a.mp4", 12.5, (66, 38), 5),
    "mp4, slow": lambda: file_answer("a.mp4", 0.5, (32, 32), 2),
    "gif": lambda: file_answer("a.gif", 30.0, (35, 27), 4),
    "rates": rates_answer,
    "smooth": smooth_answer,
    "clock": clock_answer,
    "texts": texts_answer,
    "chart": chart_answer,
}
CASES = {name: lambda answer=answer: digits(answer(), 5) for name, answer in CASES.items()}
