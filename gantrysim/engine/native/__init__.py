"""The servo tick as native code: inside MuJoCo's step, in a loop of its own, and on a GPU.

MuJoCo lets its user register one function for the whole process, the control callback `(mjModel *, mjData *)`, which it
calls in every physics step to set the actuators' controls. Numba compiles the servo tick to such a C function, so that
one call of `mj_step(model, data, nstep)` runs a whole job, and `mujoco.batch` many, without Python in between.

The tick knows nothing of MuJoCo. It works on a `row`, an array of doubles that holds the parameters and the state of
the servo, what the machine is like at a physics step, and what acts on it in the next one; and on the addresses of
NumPy's arrays that the row names, the setpoints to read and the log to write. Whoever fills in a row must keep its
arrays alive.

The callback gets two addresses and nothing else. `layout` knows where the fields of mjModel and mjData lie behind them.
One field is `userdata`, an array of doubles that MuJoCo leaves to its user. It holds the row. So every simulation
carries its own servo, and any number of them can be stepped by any number of threads. A row begins with a magic number,
by which the callback leaves all other models alone.

`plant` makes the steps itself where all joints slide, with the same tick; `engine/device.py` compiles both for a GPU.
`pointers` turns addresses into arrays inside compiled code, `tick` is the tick, `supervision` a part of it, and
`callback` makes it a callback, which is registered only while gantrysim steps. `functions` compiles functions of laws
and faults.
"""

# before numba, which the modules of this room import: the first import of it is checked there
import gantrysim.base.jit
