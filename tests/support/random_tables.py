"""Random machines from tables, and random requests of a servo for them."""

import math

from support.tables import LIBRARY

WITHOUT_AC = [name for name in LIBRARY if LIBRARY[name].get("kind") != "ac servo"]

ARRANGEMENTS = ("bridge", "table", "cantilever", "tandem", "corexy")
LAWS = (
    ["pid"],
    ["pd"],
    ["p-pi"],
    ["pid", "observer"],
    ["pid", "contour"],
    ["p-pi", "observer", "contour"],
    ["pid", "zv"],
)
IDEAL = (
    '{ kind = "brushed", voltage = 24, torque_constant = 0.05, resistance = 0.5, inductance = 0, rotor_inertia = 2e-5, '
    "continuous_torque = 0.2, peak_current = 20, max_speed = 20000, mass = 0.5 }"
)


def between(random, low, high):
    """A number whose logarithm is evenly distributed."""
    return float(f"{math.exp(random.uniform(math.log(low), math.log(high))):.3g}")


def transmission(random, kind=None):
    kind = kind or random.choice(["screw", "belt", "rack"])
    damping = between(random, 0.003, 0.1)
    if kind == "screw":
        sizes = f"lead = {random.choice([2, 5, 10, 20])}, inertia = {between(random, 1e-6, 5e-5)}"
        stiffness = between(random, 2, 200)
    else:
        pitch = "pitch = 3" if kind == "belt" else "module = 1.5"
        sizes = f"teeth = {random.randint(15, 40)}, {pitch}, ratio = {random.choice([1, 3, 5])}, "
        sizes += f"inertia = {between(random, 1e-6, 1e-4)}"
        stiffness = between(random, 0.1, 10)
    return f'{{ kind = "{kind}", {sizes}, stiffness = {stiffness}, damping_ratio = {damping} }}'


def drive(random, kind=None):
    name = random.choice([*WITHOUT_AC, "ideal"])
    motor, voltage = (IDEAL, 24) if name == "ideal" else (f'"{name}"', LIBRARY[name]["voltage"])
    return "\n".join(
        [
            f"motor = {motor}",
            f"encoder = {random.choice([500, 4000, 20000])}",
            f"voltage = {max(voltage, 24)}",
            f"current_loop = {between(random, 200, 3000)}",
            f"transmission = {transmission(random, kind)}",
        ]
    )


def table(random):
    """The text of a random machine's table."""
    arrangement = random.choice(ARRANGEMENTS)
    vertical = random.random() < 0.5
    axes = "xyz" if vertical else "xy"
    lines = [f'arrangement = "{arrangement}"']
    if arrangement == "tandem":
        lines += [f"span = {random.randint(300, 1500)}", f"skew_stiffness = {random.choice([0, 1e3, 2e4, 2e5])}"]
    if arrangement == "cantilever":
        lines.append(f"arm_stiffness = {between(random, 1e3, 1e6)}")
    moving = "table" if arrangement == "table" else "bridge"
    lines += ["[masses]", f"{moving} = {between(random, 1, 60)}", f"carriage = {between(random, 0.3, 15)}"]
    if vertical:
        lines.append(f"ram = {between(random, 0.2, 5)}")
    for axis in axes:
        lines += [f"[{axis}]", "travel = [-150, 150]"]
        lines.append(f"guides = {{ friction = 1, viscous = {random.choice([0, 1, 10, 100])} }}")
        if arrangement != "corexy" or axis == "z":
            lines += [f"[{axis}.drive]", drive(random)]
    if arrangement == "corexy":
        lines += ["[belts]", drive(random, "belt")]
    return "\n".join(lines)


def request(random, machine):
    """Random arguments of `Servo.derive` for a machine of `table`."""
    axes, period = machine.axes, random.choice([2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3])
    modes = ["torque", "velocity", "position"]
    one = random.choice(modes)
    several = [random.choice([*modes, "stepper"]) for _ in axes]
    mode = random.choice([None, one, one, one, several])
    feedback = random.choice(["motor", "motor", "load"])
    if axes[0].chain is not None:  # belts and tandem drives: all axes have one mode, and no axis its own spring
        mode = one if mode == several else mode
        feedback = "motor"
    arguments = {
        "period": period,
        "mode": mode,
        "integral_time": random.choice([math.inf, between(random, 1e-3, 1.0), between(random, 1e-2, 0.3)]),
        "damping": random.choice([1.0, 1.0, 0.7, between(random, 0.2, 4.0)]),
        "delay": random.choice([0.0, 0.0, 0.5 * period, period]),
        "feedback_delay": random.choice([0, 0, 0, 1, 3]),
        "feedback": feedback,
    }
    if all(axis.lag for axis in axes):  # a motor without inductance has no current loop
        arguments["current_bandwidth"] = random.choice([0.0, 0.0, between(random, 100, 3000)])
    if "velocity" in (mode or ()) and random.random() < 0.2:
        arguments["velocity_bandwidth"] = between(random, 3, 300)
    if random.random() < 0.4:
        arguments |= {"law": random.choice(LAWS), "mode": "torque"}
        arguments.pop("velocity_bandwidth", None)
    return arguments
