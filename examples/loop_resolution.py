"""Find out how fine the program loop of AN-225 must be, on an ideal controller and one that waits in milliseconds."""

import gantrysim as gs
from gantrysim.controllers.trio import MoveSpiral

# 1. One machine and one servo for all runs.
machine = gs.Machine("xy")
servo = gs.Servo.derive(machine.axes, integral_time=0.03)

# 2. The controller waits in whole milliseconds and computes with a resolution of its own; an ideal one would not.
limits = gs.Job.load("an225").program
wait_resolution = limits["wait_resolution"]

print(f"{'loop [s]':>10} {'ideal controller [µm]':>24} {'waits in milliseconds [µm]':>28}")
for loop_period in (1.0, 0.5, 0.2, 0.1, 0.05, 0.02):
    errors = []
    for resolution in (0.0, wait_resolution):
        # 3. The spiral as the loop writes it: one straight line for every pass of the loop.
        spiral = MoveSpiral(
            diameter=120,
            turns=4,
            thickness=10,
            speed=100,
            loop_period=loop_period,
            wait_resolution=resolution,
        )
        run = gs.simulate(machine, servo, spiral.setpoints(servo.period))

        # 4. The share of the program alone, before servo and machine add theirs.
        budget = gs.Budget(run).values
        errors.append(1e3 * budget.parts["program"].rms)
    print(f"{loop_period:>10g} {errors[0]:>24.1f} {errors[1]:>28.1f}")
