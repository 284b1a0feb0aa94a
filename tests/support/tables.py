"""Tables of machines: the examples, and one without friction."""

import tomllib
from pathlib import Path

EXAMPLES = Path(__file__).parent.parent.parent / "examples" / "machines"
LIBRARY = tomllib.loads(
    (Path(__file__).parent.parent.parent / "gantrysim/machine/design/library.toml").read_text(encoding="utf-8")
)["motors"]

# Long axes without friction and damping; a motor without inductance, 0.05 N·m/A, 24 V, 0.5 ohm, at most 20 A
IDEAL = """
arrangement = "bridge"
masses = { bridge = 2.0, carriage = 1.0 }

[x]
travel = [-1000, 90000]
speed = 9000

[x.drive]
encoder = 10000
voltage = 24
nut_mass = 0.25

[x.drive.motor]
kind = "brushed"
voltage = 24
torque_constant = 0.05
resistance = 0.5
inductance = 0
rotor_inertia = 2e-5
continuous_torque = 0.2
peak_current = 20
max_speed = 20000
mass = 0.5

[x.drive.transmission]
TRANSMISSION

[y]
travel = [-150, 150]

[y.drive]
motor = "maxon-re40-24"
encoder = 10000
voltage = 24
transmission = { kind = "screw", lead = 10, inertia = 7e-6, stiffness = 13 }
"""
SCREW = 'kind = "screw"\nlead = 20\ndiameter = 16\nlength = 600\nstiffness = 10\ndamping_ratio = 0'
BELT = 'kind = "belt"\nteeth = 25\npitch = 3\nratio = 4\ninertia = 3.2e-5\nstiffness = 1\ndamping_ratio = 0'
RACK = 'kind = "rack"\nmodule = 1\nteeth = 24\nhelix = 20\nratio = 5\ninertia = 5e-5\nstiffness = 5\ndamping_ratio = 0'


def ideal(transmission=SCREW):
    return IDEAL.replace("TRANSMISSION", transmission)


def example(name):
    """The content of an example, and the data of its motors."""
    return tomllib.loads((EXAMPLES / f"{name}.toml").read_text(encoding="utf-8"))
