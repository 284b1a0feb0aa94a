"""Models that are built from tables and URDFs: masses, joints, springs, motors, steps, drawing; and motors' data."""

import tempfile
from pathlib import Path

import mujoco
import numpy as np

from gantrysim import InputError
from gantrysim.machine.design.build import mjcf_in, mjcf_of
from gantrysim.machine.design.library import Winding, counts_of, encoder_names, largest_torque, motor_names, motor_of
from gantrysim.machine.design.table import MachineTable

SCREW = {
    "kind": "screw",
    "lead": 10,
    "diameter": 12,
    "length": 470,
    "accuracy": "C5",
    "efficiency": 0.9,
    "stiffness": 13,
    "friction": 0.012,
    "coupling_inertia": 3e-6,
}
BELT = {"kind": "belt", "teeth": 20, "pitch": 3, "ratio": 3, "inertia": 4e-5, "stiffness": 0.5, "accuracy": 60}
RACK = {"kind": "rack", "teeth": 24, "module": 1.5, "helix": 20, "ratio": 5, "inertia": 6e-5, "stiffness": 8}
LIGHT_SCREW = {"kind": "screw", "lead": 4, "inertia": 2e-6, "stiffness": 30, "damping_ratio": 0.05}
RIGID = {"kind": "screw", "lead": 20, "inertia": 7e-6, "stiffness": "rigid"}
OWN_MOTOR = {
    "kind": "bldc",
    "voltage": 48,
    "torque_constant": 0.06,
    "resistance": 0.4,
    "inductance": 2e-3,
    "rotor_inertia": 3e-5,
    "no_load_current": 0.2,
    "continuous_torque": 0.4,
    "max_speed": 9000,
    "mass": 0.9,
    "pole_pairs": 7,
    "detent_torque": 0.01,
}
AC_MOTOR = {
    "kind": "ac servo",
    "voltage": 310,
    "voltage_constant_rms": 40.0,
    "resistance_per_phase": 1.2,
    "inductance_per_phase": 4e-3,
    "rotor_inertia": 4e-5,
    "continuous_torque": 1.3,
    "peak_torque": 3.5,
    "peak_current_rms": 7.0,
    "max_speed": 5000,
    "mass": 1.5,
    "pole_pairs": 4,
}

BRUSHED = {"motor": "maxon-re40-24", "encoder": "us-digital-e5-2500", "voltage": 24, "transmission": SCREW}
OWN = {"motor": OWN_MOTOR, "encoder": 4096, "voltage": 60, "nut_mass": 0.3, "transmission": BELT}
SERVO = {
    "motor": "delta-ecma-c10604",
    "encoder": "absolute-17-bit",
    "voltage": 310,
    "current_rms": 5.0,
    "mode": "velocity",
    "transmission": RACK,
}
STEPPER = {"motor": "keli-bj42d41-14v19", "voltage": 36, "transmission": SCREW | {"accuracy": "P3"}}
QUICK_MOTOR = {
    "kind": "stepper",
    "voltage": 24,
    "holding_torque": 0.5,
    "rated_current": 2.0,
    "resistance": 1.0,
    "inductance": 2e-3,
    "rotor_inertia": 2e-6,
    "max_speed": 2000,
    "mass": 0.3,
    "pole_pairs": 50,
    "detent_torque": 0.02,
}
QUICK = {"motor": QUICK_MOTOR, "voltage": 24, "transmission": LIGHT_SCREW | {"stiffness": 0.1}}
FINE_STEPPER = STEPPER | {"microsteps": 4, "current": 1.0, "encoder": 1000, "voltage": 24}
CLOSED = {
    "motor": "stepperonline-23hs30-5004d-e1000",
    "encoder": "us-digital-e5-1000",
    "voltage": 48,
    "transmission": LIGHT_SCREW,
}
LIFT = {
    "motor": "maxon-re25-24",
    "encoder": "cui-amt102",
    "voltage": 24,
    "current_loop": 400,
    "transmission": LIGHT_SCREW,
}

ROUGH = {"friction": 2.0, "viscous": 8.0}
X = {"travel": [-150, 150], "guides": ROUGH, "drive": BRUSHED}
Y = {"travel": [-100, 220], "speed": 300, "guides": {"friction": 4.0, "viscous": 16.0}, "drive": BRUSHED}
Z = {"travel": [-5, 60], "guides": {"friction": 1.0}, "drive": LIFT}
ON_BRIDGE = {"bridge": 4.5, "carriage": 1.2}
WITH_RAM = {"ram": 0.6}


def coupled(**changes):
    slides = {name: {"travel": axis["travel"], "guides": axis["guides"]} for name, axis in (("x", X), ("y", Y))}
    belts = OWN | {"transmission": {key: value for key, value in BELT.items() if key != "accuracy"}}
    return {"arrangement": "corexy", "masses": ON_BRIDGE, "belts": belts, **slides, **changes}


TABLES = {
    "bridge": {"arrangement": "bridge", "masses": ON_BRIDGE, "x": X, "y": Y},
    "bridge with z": {
        "arrangement": "bridge",
        "name": "tall",
        "gap": 0.8,
        "masses": ON_BRIDGE | WITH_RAM,
        "x": X | {"drive": OWN},
        "y": Y | {"drive": SERVO, "speed": 900},
        "z": Z,
    },
    "table with z": {
        "arrangement": "table",
        "masses": {"table": 3.0, "carriage": 1.1} | WITH_RAM,
        "x": X | {"drive": STEPPER},
        "y": Y | {"drive": CLOSED},
        "z": Z | {"drive": FINE_STEPPER, "guides": {}},
    },
    "cantilever": {
        "arrangement": "cantilever",
        "arm_stiffness": 4e4,
        "masses": ON_BRIDGE,
        "x": X | {"travel": [-50, 400]},
        "y": Y,
    },
    "tandem": {"arrangement": "tandem", "span": 700, "skew_stiffness": 2e4, "masses": ON_BRIDGE, "x": X, "y": Y},
    "free tandem with z": {
        "arrangement": "tandem",
        "span": 300,
        "masses": ON_BRIDGE | WITH_RAM,
        "x": X,
        "y": Y | {"drive": SERVO | {"mode": "position"}},
        "z": Z,
    },
    "corexy": coupled(),
    "corexy, slow": coupled(
        x={"travel": [-100, 180], "speed": 200.0}, y={"travel": [-50, 60], "speed": 150.0, "guides": {"viscous": 3.0}}
    ),
    "rigid": {
        "arrangement": "bridge",
        "masses": ON_BRIDGE,
        "x": {"travel": [0, 1], "drive": OWN | {"transmission": RIGID, "mode": "velocity"}},
        "y": Y | {"drive": BRUSHED | {"transmission": RIGID, "current": 3.0}},
    },
}


def used(values):
    """Index and value of each number that is not zero."""
    values = np.ravel(values)
    return [[int(k), float(values[k])] for k in np.flatnonzero(values)]


def drawn(model, body):
    """Number of a body's geoms, and sums of their positions, sizes, turns and colours, each weighted by its place."""
    geoms = np.flatnonzero(model.geom_bodyid == body)
    weight = 1.0 + np.arange(len(geoms))
    materials = model.geom_matid[geoms]
    colours = np.where(materials[:, None] >= 0, model.mat_rgba[np.maximum(materials, 0)], model.geom_rgba[geoms])
    parts = (model.geom_pos, model.geom_size, model.geom_quat)
    return [
        len(geoms),
        *np.concatenate([weight @ part[geoms] for part in parts]).tolist(),
        float(weight @ colours.sum(1)),
    ]


def named(model, count, accessor):
    return [(element.name, element.id) for element in (accessor(k) for k in range(count))]


def model_answer(model):
    """The numbers of a compiled model that its table decides."""
    bodies = {
        name: [
            model.body_mass[b],
            *model.body_inertia[b],
            *model.body_ipos[b],
            *model.body_pos[b],
            *model.body_quat[b],
            model.body_gravcomp[b],
        ]
        for name, b in named(model, model.nbody, model.body)
    }
    joints = {
        name: {
            "kind": int(model.jnt_type[j]),
            "place": [*model.jnt_axis[j], *model.jnt_pos[j]],
            "range": [*model.jnt_range[j], *model.jnt_user[j], *model.jnt_solref[j]],
            "spring": [model.jnt_stiffness[j], model.dof_damping[model.jnt_dofadr[j]]],
            "friction": float(model.dof_frictionloss[model.jnt_dofadr[j]]),
        }
        for name, j in named(model, model.njnt, model.joint)
    }
    motors = {
        name: {
            "gear": [model.actuator_gear[a, 0], model.actuator_armature[a], model.actuator_damping[a]],
            "gain": used(model.actuator_gainprm[a]),
            "bias": used(model.actuator_biasprm[a]),
            "dynamics": used(model.actuator_dynprm[a]),
            "control": model.actuator_ctrlrange[a],
        }
        for name, a in named(model, model.nactuator, model.actuator)
    }
    tendons = {
        name: [
            model.tendon_stiffness[t],
            model.tendon_damping[t],
            *model.tendon_lengthspring[t],
            *model.wrap_prm[model.tendon_adr[t] : model.tendon_adr[t] + model.tendon_num[t]],
        ]
        for name, t in named(model, model.ntendon, model.tendon)
    }
    numerics = {
        name: model.numeric_data[model.numeric_adr[n] : model.numeric_adr[n] + model.numeric_size[n]]
        for name, n in named(model, model.nnumeric, model.numeric)
    }
    return {
        "step": model.opt.timestep,
        "bodies": bodies,
        "joints": joints,
        "motors": motors,
        "tendons": tendons,
        "encoders": {name: model.sensor_user[s] for name, s in named(model, model.nsensor, model.sensor)},
        "numerics": numerics,
        "drawn": {name: drawn(model, b) for name, b in named(model, model.nbody, model.body) if model.body_geomnum[b]},
        "views": {name: model.cam_pos[c] for name, c in named(model, model.ncam, model.camera)},
        "lights": model.light_pos,
    }


def table_answer(content):
    return model_answer(mujoco.MjModel.from_xml_string(mjcf_of(MachineTable.model_validate(content))))


def steps_answer(drive, key, values):
    """Physics steps of a bridge whose x axis has other numbers."""
    steps = []
    for value in values:
        transmission = drive["transmission"] | ({key: value} if key == "stiffness" else {})
        changed = drive | {"transmission": transmission} | ({} if key == "stiffness" else {key: value})
        content = TABLES["bridge"] | {"x": X | {"drive": changed}}
        steps.append(mujoco.MjModel.from_xml_string(mjcf_of(MachineTable.model_validate(content))).opt.timestep)
    return steps


# a bed on y under a carriage that looks the other way, so that both joints count against their axes
INERTIA = '<inertia ixx="0.01" iyy="0.02" izz="0.025" ixy="0" ixz="0" iyz="0"/>'
URDF = f"""
<robot name="printer">
  <link name="frame"><collision><geometry><box size="0.9 0.8 0.1"/></geometry></collision></link>
  <link name="bed"><inertial><mass value="4"/>{INERTIA}</inertial>
    <visual><geometry><mesh filename="package://printer/meshes/bed.obj"/></geometry></visual>
    <collision><geometry><box size="0.3 0.2 0.02"/></geometry></collision></link>
  <link name="carriage"><inertial><mass value="2"/>{INERTIA}</inertial>
    <visual><geometry><box size="0.06 0.06 0.1"/></geometry></visual></link>
  <link name="ram"><inertial><mass value="1"/>{INERTIA}</inertial></link>
  <link name="tool"/>
  <joint name="jy" type="prismatic"><parent link="frame"/><child link="bed"/>
    <origin xyz="0.3 0.2 0.1" rpy="0 0 1.5707963267948966"/><axis xyz="1 0 0"/>
    <limit lower="-0.1" upper="0.15" effort="100" velocity="0.2"/></joint>
  <joint name="jx" type="prismatic"><parent link="frame"/><child link="carriage"/>
    <origin xyz="0.3 0.2 0.3" rpy="0 0 3.141592653589793"/><axis xyz="1 0 0"/>
    <limit lower="-0.1" upper="0.2" effort="100" velocity="9"/><dynamics damping="7" friction="3"/></joint>
  <joint name="jz" type="prismatic"><parent link="carriage"/><child link="ram"/>
    <origin xyz="0 0 -0.05"/><axis xyz="0 0 1"/><limit lower="-0.001" upper="0.08" effort="1" velocity="9"/></joint>
  <joint name="mount" type="fixed"><parent link="ram"/><child link="tool"/><origin xyz="0 0.01 -0.03"/></joint>
</robot>
"""
URDF_DRIVE = """
motor = "maxon-re40-48"
encoder = 10000
voltage = 48
transmission = { kind = "screw", lead = 5, inertia = 2e-6, stiffness = 40 }
"""
URDF_TABLE = f"""
urdf = "printer.urdf"
nozzle = {{ link = "tool", position = [3, 0, -40] }}
work = "bed"
[x]
joint = "jx"
[x.drive]{URDF_DRIVE}
[y]
joint = "jy"
[y.drive]{URDF_DRIVE}
[z]
joint = "jz"
[z.drive]{URDF_DRIVE}
"""
CUBE = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
URDFS = {
    "as it is": {},
    "travel, speed and guides of the table": {
        '[x]\njoint = "jx"': '[x]\njoint = "jx"\ntravel = [-90, 110]\nspeed = 70\nguides = {friction = 1, viscous = 2}',
        'work = "bed"': 'work = "bed"\ngap = 1.25',
    },
    "nozzle on the ram, upside down": {
        'link = "tool", position = [3, 0, -40]': 'link = "ram"',
        '<axis xyz="0 0 1"/>': '<axis xyz="0 0 -1"/>',
    },
    "bed at rest": {
        'name="jy" type="prismatic"': 'name="jy" type="fixed"',
        f'[y]\njoint = "jy"\n[y.drive]{URDF_DRIVE}': "",
    },
    "nozzle on the carriage": {
        'name="jz" type="prismatic"': 'name="jz" type="fixed"',
        f'[z]\njoint = "jz"\n[z.drive]{URDF_DRIVE}': "",
        'link = "tool", position': 'link = "carriage", position',
    },
    "work on the frame": {'work = "bed"': 'work = "frame"'},
    "no joint named": {
        f'[x]\njoint = "jx"\n[x.drive]{URDF_DRIVE}\n[y]\njoint = "jy"\n[y.drive]{URDF_DRIVE}\n[z]\njoint = "jz"\n'
        f"[z.drive]{URDF_DRIVE}": ""
    },
    "one joint twice": {'joint = "jy"': 'joint = "jx"'},
    "no such joint": {'joint = "jy"': 'joint = "jq"'},
    "a fixed joint": {'joint = "jy"': 'joint = "mount"'},
    "a joint without a drive": {f'[y]\njoint = "jy"\n[y.drive]{URDF_DRIVE}': ""},
    "no such link": {'work = "bed"': 'work = "plate"'},
    "bed above everything": {'link="frame"/><child link="carriage"/>': 'link="bed"/><child link="carriage"/>'},
    "another root": {"<robot": "<machine", "</robot": "</machine"},
    "no XML": {"</robot>": ""},
    "a root named world": {
        '"frame"': '"world"',
        'name="jy" type="prismatic"': 'name="jy" type="fixed"',
        f'[y]\njoint = "jy"\n[y.drive]{URDF_DRIVE}': "",
        'work = "bed"': 'work = "world"',
    },
    "no limits": {'<limit lower="-0.1" upper="0.2" effort="100" velocity="9"/>': ""},
    "no mass": {'<mass value="1"/>': '<mass value="-1"/>'},
    "a mesh that is lost": {"bed.obj": "lost.obj"},
    "a mesh of another format": {"bed.obj": "bed.dae"},
}


def urdf_answer(changes, name):
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "robots"
        place.mkdir()
        (Path(folder) / "meshes").mkdir()
        (Path(folder) / "meshes" / "bed.obj").write_text(CUBE, encoding="utf-8")
        for file, text in (("printer.urdf", URDF), ("printer.toml", URDF_TABLE)):
            for old, new in changes.items():
                text = text.replace(old, new)
            (place / file).write_text(text, encoding="utf-8")
        try:
            text = mjcf_in(place / name)
        except InputError as error:
            return str(error).replace(f"{place}/", "")
        # the mesh is read again
        return model_answer(mujoco.MjModel.from_xml_string(text))


def motor_answer(name):
    motor = motor_of(name)
    voltage = 1.2 * motor.voltage
    speeds = (0.0, 100.0, 300.0, 600.0)
    return [
        motor.kind,
        [
            motor.K,
            motor.resistance,
            motor.inductance,
            motor.rotor_inertia,
            motor.pole_pairs,
            motor.max_speed,
            motor.mass,
        ],
        [motor.current, motor.continuous, *motor.friction, motor.detent_torque, *motor.computed_ratings.values()],
        [motor.torque_at(speed, voltage, motor.current) for speed in speeds],
    ]


def torque_answer():
    """Largest torque at rest, slow and fast, of windings with and without poles, limited by voltage or current."""
    windings = [Winding(0.05, 0.5, 0.0, 0.0), Winding(0.05, 0.5, 2e-3, 0.0), Winding(0.4, 1.0, 3e-3, 50.0)]
    return [
        [largest_torque(winding, speed, voltage, current) for speed in (0.0, 20.0, 100.0, 479.0, 700.0, -50.0)]
        for winding in windings
        for voltage, current in ((24.0, 10.0), (24.0, 100.0))
    ]


CASES = {f"table, {name}": lambda content=content: table_answer(content) for name, content in TABLES.items()}
CASES |= {
    "steps, stiffness": lambda: steps_answer(BRUSHED, "stiffness", [1, 4, 16, 64, 256, 1024]),
    "steps, stepper's stiffness": lambda: steps_answer(STEPPER, "stiffness", [1, 4, 16, 64, 256, 1024]),
    "steps, stepper's current": lambda: steps_answer(QUICK, "current", [0.02, 0.2, 0.7, 1.2, 2.8]),
}
CASES |= {
    f"urdf, {name}": lambda changes=changes: urdf_answer(changes, "printer.urdf") for name, changes in URDFS.items()
}
CASES |= {"urdf, by its table": lambda: urdf_answer({}, "printer.toml")["step"]}
CASES |= {f"motor {name}": lambda name=name: motor_answer(name) for name in motor_names()}
CASES |= {"own motor": lambda: motor_answer(OWN_MOTOR), "own ac servo": lambda: motor_answer(AC_MOTOR)}
CASES |= {"encoders": lambda: [counts_of(name) for name in [*encoder_names(), 123.0]], "torques": torque_answer}
