"""The servo tick as native code inside MuJoCo's step.

MuJoCo lets its user register one function for the whole process, the control callback `(mjModel *, mjData *)`, which it
calls in every physics step to set the actuators' controls. Numba compiles the servo tick to such a C function, so that
one call of `mj_step(model, data, nstep)` runs a whole job, and `mujoco.batch` many, without Python in between.

The callback gets two addresses and nothing else. `layout` knows where the fields of mjModel and mjData lie behind them.
One field is `userdata`, an array of doubles that MuJoCo leaves to its user. It holds a `row`: the parameters and the
state of the servo, and the addresses of two of NumPy's arrays, the setpoints to read and the log to write. So every
simulation carries its own servo, and any number of them can be stepped by any number of threads. Whoever fills in a
row must keep its arrays alive. A row begins with a magic number, by which the callback leaves all other models alone.

`pointers` turns addresses into arrays inside compiled code, `tick` is the callback, `supervision` a part of it. `parts`
compiles functions of laws and faults. `hook` registers the callback only while gantrysim steps.
"""

# before numba, which the modules of this room import: the first import of it is checked there
import gantrysim.base.jit
