"""Kinematics, errors of the geometry, deviations, tolerances, travel and outlines of machines of every kind."""

import re
import tempfile
from dataclasses import fields
from functools import cache
from pathlib import Path

import numpy as np

from gantrysim import InputError, Machine
from gantrysim.machine.axis import axis_table
from gantrysim.machine.checks import notes, shaft_inertia, weights
from gantrysim.machine.geometry import ERRORS, SCREWS, Geometry, typical
from gantrysim.machine.ideal import frictionless_machine, without_compliance, without_friction, without_winding
from gantrysim.machine.outline import outline
from gantrysim.machine.perturbation import Perturbation
from gantrysim.machine.scheme import scheme
from gantrysim.machine.sizing import Sizing
from gantrysim.machine.timing import delay_steps, substeps_of
from gantrysim.machine.tolerances import Tolerances, in_words
from gantrysim.machine.travel import has_no_constraints_but_stops, stops_of, travel_edit

from support.mechanisms import COREXY, TANDEM

HERE = Path(__file__).parent
EXAMPLES = HERE.parent.parent / "examples" / "machines"
RIGID = (HERE.parent / "refused" / "rigid.xml").read_text(encoding="utf-8")
BUILT_IN = ("xy", "xyz", "xyzr", "stage", "delta")
TEXTS = {"rigid": RIGID, "belts": COREXY, "mounts": TANDEM}
# a column under the work: z carries x
COLUMN = RIGID.replace(
    '<body name="bridge">\n      <joint name="y" axis="0 1 0"/>',
    '<body name="column">\n      <joint name="z" axis="0 0 1"/>\n      <geom size="0.01" mass="2"/>\n'
    '      <body name="bridge">\n      <joint name="y" axis="0 1 0"/>',
).replace('<site name="nozzle"/>\n      </body>', '<site name="nozzle"/>\n      </body></body>')
COLUMN = COLUMN.replace('<dcmotor name="y" joint="y"/>', '<dcmotor name="y" joint="y"/><dcmotor name="z" joint="z"/>')
TEXTS["column"] = COLUMN


def of_text(text):
    """A machine of an MJCF's text."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "machine.xml"
        file.write_text(text, encoding="utf-8")
        return Machine(file)


@cache
def machine_of(name):
    if name in TEXTS:
        return of_text(TEXTS[name])
    return Machine(name if name in BUILT_IN else EXAMPLES / f"{name}.toml")


def spread(machine, count=7):
    """Positions of the axes across their travel, each in another order."""
    low, high = np.array([axis.travel for axis in machine.axes]).T
    low, high = (np.where(np.isfinite(end), end, default) for end, default in ((low, -180.0), (high, 180.0)))
    shares = (0.13 + np.outer(np.arange(count), [0.61, 0.37, 0.83, 0.29, 0.53, 0.71][: len(low)])) % 1.0
    return low + shares * (high - low)


def reached(kinematics, position):
    try:
        return kinematics.inverse(np.array([position]))[0]
    except InputError as error:
        return str(error)


def highest(kinematics):
    return np.array([coordinate.travel[1] for coordinate in kinematics.coordinates])


def spread_coordinates(kinematics):
    """Positions within 0.9 of the travel of each coordinate, and at its ends."""
    low, high = np.array([coordinate.travel for coordinate in kinematics.coordinates]).T
    shares = (0.13 + np.outer(np.arange(4), [0.61, 0.37, 0.83, 0.29][: len(low)])) % 1.0
    inside = low + (0.05 + 0.9 * shares) * (high - low)
    return [*inside, low, high, high + 5e-10]


def kinematics_answer(name):
    machine = machine_of(name)
    kinematics = machine.kinematics
    axes = spread(machine)
    coordinates = kinematics.forward(axes)
    return {
        "coordinates": [[each.name, each.unit, *each.travel] for each in kinematics.coordinates],
        "home": machine.home,
        "forward": coordinates,
        "tip": machine.tip(axes),
        "follow": kinematics.follow(axes),
        "inverse": [reached(kinematics, position) for position in spread_coordinates(kinematics)],
        "beyond": [
            reached(kinematics, 1.01 * position) for position in np.eye(len(kinematics.names)) * highest(kinematics)
        ],
        "qpos": machine.to_qpos(axes[:2]),
        "gap": [machine.gap, machine.over_work, machine.depth_in_work, machine.needle, machine.turns_work],
    }


def delta_answer():
    """Positions of a delta robot whose slides do not end before its arms."""
    machine = machine_of("delta").edited(open_slides)
    return [reached(machine.kinematics, machine.home.round(6) + np.array([*place, 0.0])) for place in PLACES]


def open_slides(spec):
    for joint in spec.joints:
        if joint.name not in ("a", "b", "c"):
            joint.range = [-9.0, 9.0]


# displacements of the platform: within reach, beyond it, and near a line of arm and rod or flat rods on both sides
PLACES = [
    *(
        (0, 0, -280),
        (0, 0, -120),
        (0, 0, 0),
        (60, 20, 200),
        (-90, 40, 330),
        (200, 0, -120),
        (0, -330, 0),
        (280, 250, 330),
    ),
    *((60, 20, -153), (60, 20, -150), (60, 20, 228), (60, 20, 232), (200, 0, 252), (0, -330, 380), (-250, 180, 340)),
    *((350, 0, 16), (0, -330, 4), (280, 250, 60), (280, 250, 68), (280, 250, 70), (-250, 180, -20), (-400, 0, 92)),
]

# tips of a machine with one error at a time

WITH_ERRORS = ("xyz", "stepper", "cantilever", "column")
MAGNITUDES = {"play": 0.05, "periodic_error": 0.02, "racking": 0.3}


def to_and_fro(machine):
    """A path that reverses, (n, axes)."""
    corners = spread(machine, 5)
    return np.concatenate([corners, corners[::-1] + 0.02, corners[1:3] - 0.01])


def displacement(machine, geometry, scales=False):
    """Displacement of the nozzle by the errors of a geometry [µm], or why the machine has none."""
    try:
        errors = machine.with_geometry(geometry).kinematic_errors
    except InputError as error:
        return str(error)
    path = to_and_fro(machine)
    # in two blocks, as those of a long run
    moved = np.concatenate(list(errors.tips([path[:6], path[6:]], scales)))
    return 1e3 * (moved - machine.tip(path))


def sums(displacement):
    """Weighted sums of the columns, in which each row counts."""
    if isinstance(displacement, str):
        return displacement
    return (1.0 + 0.1 * np.arange(len(displacement))) @ displacement


def errors_answer(name):
    machine = machine_of(name)
    return {error: sums(displacement(machine, Geometry(**{error: MAGNITUDES.get(error, -0.08)}))) for error in ERRORS}


FURTHER = {
    "class": {"accuracy": "C7"},
    "class, with others": {"accuracy": "P3", "play": 0.0, "squareness_xy": 0.1},
    "force on the ram": {"bending_x": 0.03, "bending_y": -0.02, "bending_load": "force", "ram": 60.0},
    "warm screws": {"warming": 7.0, "fixed_end": -40.0},
    "warm brass": {"warming": -7.0, "expansion": 18e-6},
    "warm scales": {"scale_warming": 4.0, "scale_fixed": 25.0},
    "warm scales of steel": {"scale_warming": 4.0, "scale_expansion": 11e-6},
    "yaw with levers": {"yaw": 0.2, "abbe": 30.0, "guide_arm": -50.0},
    "racking with levers": {"racking": 0.4, "abbe": -20.0, "guide_arm": 70.0},
}
LISTS = {
    "play of each": {"play": (0.01, 0.02, 0.03)},
    "straightness of each": {"straightness": (0.01, -0.02, 0.03)},
    "yaw of z": {"yaw": (0.1, 0.0, 0.1)},
    "travel of two": {"travel_error": (0.1, 0.0)},
    "abbe of each": {"yaw": 0.1, "abbe": (5.0, 10.0, 15.0), "guide_arm": (1.0, 2.0, 3.0)},
}


def further_answer(name):
    machine = machine_of(name)
    answer = {case: sums(displacement(machine, Geometry(**errors))) for case, errors in FURTHER.items()}
    warm = Geometry(scale_warming=4.0, scale_fixed=25.0, warming=3.0, play=0.02)
    answer["on scales"] = sums(displacement(machine, warm, True))
    if len(machine.axes) == 3:
        answer |= {case: sums(displacement(machine, Geometry(**errors))) for case, errors in LISTS.items()}
        answer["x on a scale"] = sums(displacement(machine, warm, [True, False, False]))
    errors = machine.with_geometry(Geometry(accuracy="C5")).kinematic_errors
    return answer | {"values": errors.values}


def stated_answer():
    """Errors that tables state, and those that other machines cannot have."""
    answer = {}
    for name in ("stepper", "cantilever", "tandem"):
        geometry = machine_of(name).geometry
        answer[f"{name}, stated"] = [geometry.travel_error, geometry.periodic_error]
    answer["corexy, stated"] = machine_of("corexy").geometry
    for name in ("stage", "delta", "corexy", "belts"):
        for error in ("play", "travel_error", "yaw", "racking"):
            answer[f"{name}, {error}"] = sums(displacement(machine_of(name), Geometry(**{error: 0.05})))
        answer[f"{name}, class"] = sums(displacement(machine_of(name), Geometry(accuracy="C5")))
        answer[f"{name}, warm"] = sums(displacement(machine_of(name), Geometry(warming=5.0)))
    return answer


def bound_answer():
    """Sentences of a geometry's values beyond their bounds; those at them are accepted."""
    answer = {}
    for field in fields(Geometry):
        for value in (1e9, -1e9):
            try:
                Geometry(**{field.name: value})
            except (InputError, TypeError) as error:
                answer[f"{field.name} = {value}"] = str(error)
            else:
                answer[f"{field.name} = {value}"] = ""
        bounds = re.search(r"must be (-?[\d.e+-]+) to (-?[\d.e+-]+)", answer[f"{field.name} = {1e9}"])
        for bound in bounds.groups() if bounds else ():
            Geometry(**{field.name: float(bound)})
    return answer


# deviations

CHANGED = (
    *("body_mass", "body_gravcomp", "qpos0", "jnt_stiffness", "dof_frictionloss", "dof_damping", "dof_invweight0"),
    *("tendon_stiffness", "tendon_lengthspring", "tendon_length0", "actuator_gainprm", "actuator_biasprm"),
    *("actuator_dynprm", "actuator_forcerange", "actuator_ctrlrange", "actuator_damping", "numeric_data"),
)
DEVIATIONS = {
    "payload": {"payload": 0.4},
    "less": {"payload": -0.1},
    "friction": {"friction": 1.5},
    "viscous": {"viscous": 0.5},
    "stiffness": {"stiffness": 0.7},
    "motor constant": {"motor_constant": 1.1},
    "home": {"home_offset": 0.3},
    "friction of x": {"friction": {"x": 2.0}, "home_offset": {"x": -0.2}},
    "stiffness of x": {"stiffness": {"x": 2.0}},
}


def perturbed_answer(name):
    machine = machine_of(name)
    answer = {}
    for case, deviation in DEVIATIONS.items():
        try:
            perturbed = machine.perturbed(Perturbation(**deviation))
        except InputError as error:
            answer[case] = str(error)
            continue
        before = machine.physics
        after = perturbed.physics
        changes = {array: np.ravel(getattr(after, array)) - np.ravel(getattr(before, array)) for array in CHANGED}
        arrays = {array: np.ravel(getattr(perturbed.arrays, array)) for array in CHANGED[:6]}
        answer[case] = {
            "arrays": {
                array: [int(np.count_nonzero(change)), float((1.0 + np.arange(change.size)) @ change)]
                for array, change in changes.items()
                if change.any()
            },
            "alike": all((arrays[array] == np.ravel(getattr(after, array))).all() for array in arrays),
            "axes": [
                [axis.motor_constant, axis.peak_torque, axis.coulomb, axis.viscous, *axis.friction, axis.inertia]
                for axis in perturbed.axes
            ],
            "gain": perturbed.drive_gain,
            "qpos": perturbed.to_qpos(np.zeros(len(machine.axes))),
        }
    return answer


def tolerances_answer(name):
    machine = machine_of(name)
    if name == "xyz":
        machine = machine.with_geometry(Geometry(accuracy="C5", warming=2.0))
    tolerances = Tolerances.parse("payload=0.5, viscous=0.2")
    sampled = tolerances.sample(np.random.default_rng(3), machine)
    perturbed = machine.perturbed(tolerances.perturbation(sampled, machine))
    return {
        "columns": tolerances.columns(machine),
        "sampled": sampled,
        "hypercube": tolerances.hypercube(machine, 3, 1),
        "words": [in_words(column) for column in tolerances.columns(machine)],
        "errors": None if perturbed.kinematic_errors is None else perturbed.kinematic_errors.values,
    }


IDEALS = {
    "friction": without_friction,
    "no friction": frictionless_machine,
    "winding": without_winding,
    "compliance": without_compliance,
}


def ideal_answer(name):
    machine = machine_of(name)
    answer = {}
    for case, ideal in IDEALS.items():
        changed = ideal(machine)
        model = changed.physics
        answer[case] = {
            "same": changed is machine,
            "sizes": [model.nq, model.nv, model.na, model.neq, model.ntendon, model.nkey],
            "joints": [[*model.jnt_range[j], model.jnt_stiffness[j]] for j in range(model.njnt)],
            "loss": [float(model.dof_frictionloss.sum()), float(model.tendon_frictionloss.sum())],
            "damping": model.dof_damping,
            "motors": [float((1.0 + np.arange(values.size)) @ values.ravel()) for values in motor_arrays(model)],
            "equality": [*model.eq_data[:, 0], *model.eq_solref.ravel(), *model.eq_solimp.ravel()],
            "springs": [*model.tendon_stiffness, *model.tendon_damping],
            "efficiency": [axis.efficiency for axis in changed.axes],
            "inertia": [axis.inertia for axis in changed.axes],
        }
    return answer


def motor_arrays(model):
    return model.actuator_gainprm, model.actuator_biasprm, model.actuator_dynprm, model.actuator_damping


TRAVELS = {"xyz": {"x": (-10.0, 20.0), "z": (-1.0, 5.5)}, "xyzr": {"r": (-90.0, 45.0)}, "rigid": {"y": (3.0, 4.0)}}


def travel_answer(name):
    machine = machine_of(name)
    changed = machine.edited(travel_edit(machine.axes, TRAVELS[name]))
    return {
        "travel": [axis.travel for axis in changed.axes],
        "stops": stops_of(changed.physics),
        "only stops": [has_no_constraints_but_stops(model) for model in (machine.physics, changed.physics)],
    }


def steps_answer():
    machine = machine_of("rigid")
    cases = [(0.002,), (0.002, 0.0005), (0.002, 3e-4), (0.002, None, 0.001), (0.002, 3e-4, 0.001), (0.0007,)]
    cases += [(0.002, 6e-4), (0.002, 5e-8), (0.002, 1e-7)]
    answer = []
    for case in cases:
        try:
            answer.append([list(case), substeps_of(machine, *case)])
        except InputError as error:
            answer.append([list(case), str(error)])
    for delay in (0.0, 0.0005, 0.0012, 0.0005000001):
        try:
            answer.append([delay, delay_steps(delay, 0.001, 4)])
        except InputError as error:
            answer.append([delay, str(error)])
    return answer


def drawing_answer(name):
    """Colours, number and weighted places of the polygons that draw a machine, and its table."""
    machine = machine_of(name)
    text = scheme(machine.model, machine.to_qpos(spread(machine, 1)[0]), "a machine")
    polygons = re.findall(r'points="([^"]*)" fill="([^"]*)"', text)
    corners = [np.array([pair.split(",") for pair in points.split()], float) for points, _ in polygons]
    weights_of = 1.0 + np.arange(len(polygons))
    return {
        "head": text[: text.index("<polygon")],
        "count": [len(polygons), sum(map(len, corners))],
        "places": weights_of @ np.array([corner.mean(axis=0) for corner in corners]) / weights_of.sum(),
        "areas": float(weights_of @ [np.ptp(corner, axis=0).prod() for corner in corners]),
        "colours": [colour for _, colour in polygons][:: max(len(polygons) // 6, 1)],
        "table": axis_table(f"machine {name}", machine.axes),
    }


def outline_answer(name):
    machine = machine_of(name)
    positions = spread(machine, 3)
    answer = []
    for part in outline(machine, positions):
        weight = 1.0 + np.arange(len(part.solids))
        answer.append(
            [
                part.name,
                " ".join(solid.kind + "!" * solid.needle for solid in part.solids),
                [float(weight @ [total(solid) for solid in part.solids]) for total in TOTALS],
                part.position.ravel(),
                part.rotation.ravel(),
            ]
        )
    return answer


TOTALS = (
    lambda solid: float(solid.size @ [1.0, 2.0, 3.0]),
    lambda solid: float(solid.position @ [1.0, 2.0, 3.0]),
    lambda solid: float(np.abs(solid.rotation) @ [1.0, 2.0, 3.0, 4.0]),
)

# notes on doubtful machines

PLATE = '<body name="work"><geom type="box" size="0.1 0.1 0.01" pos="0 0 {z}" contype="0" conaffinity="0"/></body>'
TOUCHED = '<body name="work"><geom name="plate" type="box" size="0.1 0.1 0.01" pos="0 0 -0.019"/></body>'
WORK = '<body name="work"/>'
BALL = '<geom type="sphere" size="0.01" mass="1"/>'
AWAY = '<geom type="sphere" size="0.01" mass="1" pos="0 0 0.3" contype="0" conaffinity="0"/>'
HEAVY = '<geom type="sphere" size="0.01" mass="3"/>'
X_MOTOR = '<dcmotor name="x" joint="x"/>'
NOTED = {
    "no work": {},
    "5 mm above": {BALL: AWAY, WORK: PLATE.format(z=-0.015)},
    "5.1 mm above": {BALL: AWAY, WORK: PLATE.format(z=-0.0151)},
    "on the surface": {BALL: AWAY, WORK: PLATE.format(z=-0.01)},
    "2 µm inside": {BALL: AWAY, WORK: PLATE.format(z=-0.009998)},
    "1 mm inside": {BALL: AWAY, WORK: PLATE.format(z=-0.009)},
    "no rotor": {BALL: AWAY, 'armature="1.5e-5" ': ""},
    "a rotor in the joint": {'armature="1.5e-5" ': "", '<joint name="x"': '<joint armature="2" name="x"'},
    "friction of joints": {BALL: AWAY, '<joint name="x"': '<joint frictionloss="4" name="x"'},
    "friction of motors": {BALL: AWAY, X_MOTOR: '<dcmotor name="x" joint="x" lugre="40 0.1 0.01 0.012 1"/>'},
    "an ideal motor": {BALL: AWAY, X_MOTOR: '<motor name="x" joint="x" gear="400" ctrlrange="-3 2"/>'},
    "two touch": {WORK: TOUCHED, 'size="0.01" mass="3"': 'name="load" size="0.01" mass="3"'},
    "many touch": {WORK: TOUCHED, BALL: BALL + BALL + BALL},
    "weight": {BALL: AWAY, 'gravity="0 0 0"': 'gravity="2 0 -9.81"', WORK: PLATE.format(z=-0.0105)},
    "constant torque": {
        BALL: AWAY,
        "</mujoco>": '<custom><numeric name="constant_torque" data="0.02 -0.01"/><numeric name="viscous_difference" '
        'data="1 -2"/><numeric name="efficiency" data="0.8 0.9"/><numeric name="continuous_torque" data="0.1 0.2"/>'
        '<numeric name="rotor_inertia" data="1e-5 1e-6"/></custom></mujoco>',
    },
    "slow, fast, weak": {
        BALL: AWAY,
        'range="-0.2 0.2" user="1"': 'range="-0.2 0.2" user="9"',
        X_MOTOR: '<dcmotor name="x" joint="x" damping="0.002" saturation="0 0.5 0"/>',
        'actuator="x" user="10000"': 'actuator="x" user="100"',
    },
    "no speed, no encoder": {BALL: AWAY, ' user="1"/>': "/>", '<actuatorpos name="x" actuator="x" user="10000"/>': ""},
}


def noted_answer(changes):
    text = RIGID
    if BALL in changes:
        text = text.replace(HEAVY, AWAY.replace('"1"', '"3"'))
    for old, new in changes.items():
        assert old in text, old
        text = text.replace(old, new)
    machine = of_text(text)
    model = machine.model
    sizing = Sizing.of(machine)
    return {
        "notes": list(notes(machine)),
        "weights": weights(machine),
        "shaft": [shaft_inertia(model, a) for a in range(model.nactuator)],
        "axes": [
            [
                axis.inertia,
                axis.coulomb,
                axis.viscous,
                axis.peak_torque,
                axis.speed_limit,
                axis.resolution,
                *axis.friction,
            ]
            for axis in machine.axes
        ],
        "sizing": [[value for key, value in vars(axis).items() if key != "axis"] for axis in sizing.axes],
        "findings": list(sizing.findings),
    }


CASES = {
    f"kinematics, {name}": lambda name=name: kinematics_answer(name)
    for name in (*BUILT_IN, "corexy", "tandem", "belts", "mounts", "column")
}
CASES |= {"kinematics, delta's limits": delta_answer}
CASES |= {f"errors, {name}": lambda name=name: errors_answer(name) for name in WITH_ERRORS}
CASES |= {f"more errors, {name}": lambda name=name: further_answer(name) for name in ("xyz", "stepper", "column")}
CASES |= {"errors, of others": stated_answer, "errors, bounds": bound_answer}
CASES |= {"errors, classes": lambda: {name: list(typical(name).values()) for name in SCREWS}}
CASES |= {
    f"deviations, {name}": lambda name=name: perturbed_answer(name) for name in ("xyz", "delta", "tandem", "corexy")
}
CASES |= {f"tolerances, {name}": lambda name=name: tolerances_answer(name) for name in ("xyz", "tandem", "corexy")}
CASES |= {
    f"ideal, {name}": lambda name=name: ideal_answer(name) for name in ("xyz", "rigid", "delta", "tandem", "corexy")
}
CASES |= {f"travel, {name}": lambda name=name: travel_answer(name) for name in TRAVELS}
CASES |= {"steps": steps_answer}
CASES |= {f"drawing, {name}": lambda name=name: drawing_answer(name) for name in ("xyz", "stage", "delta")}
CASES |= {f"outline, {name}": lambda name=name: outline_answer(name) for name in ("xyzr", "stage", "stepper")}
CASES |= {f"noted, {name}": lambda changes=changes: noted_answer(changes) for name, changes in NOTED.items()}
