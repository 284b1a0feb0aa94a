"""Lay one spiral of glue on the benchtop machine, and find out what spoils the bead and whether it is good enough."""

import gantrysim as gs
from gantrysim.controllers.trio import MoveSpiral

# 1. The machine and its servo. The gains follow from inertia and lags, and keep a gain margin of 2.
machine = gs.Machine("xy")
servo = gs.Servo.derive(machine.axes, integral_time=0.03)

# 2. The program: the spiral of Trio's AN-225, turns 10 mm apart, written by a program loop of 0.1 s.
spiral = MoveSpiral(diameter=120, turns=4, thickness=10, speed=100, loop_period=0.1)
setpoints = spiral.setpoints(servo.period)

# 3. The valve. It opens 5 ms late, and lays 200 mm³/s.
dispenser = gs.Dispenser(flow=200, dead_time=0.005)

# 4. The run: positions and torques of every tick.
run = gs.simulate(machine, servo, setpoints, dispenser=dispenser)

# 5. Where the error arises, link by link from the program to the nozzle.
budget = gs.Budget(run)
print(budget)

# 6. The bead that lies on the work.
bead = gs.Bead(run)
print(bead)

# 7. Is it good enough? The tolerances are yours: here 0.3 mm beside the path at most.
tolerances = gs.Job.load("an225", ["tolerance.path_max=0.3", "tolerance.path_p95=0.3"])
print(gs.Verdict.of(tolerances, run))
