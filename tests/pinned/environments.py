"""What the registered environments return over a few steps of drawn actions, and tables that are read."""

import tempfile
from pathlib import Path

import gymnasium
import numpy as np

from gantrysim.env.registry import TASKS
from gantrysim.tables.column_table import Source
from gantrysim.tables.reading import read_table

STEPS = 4
SEED = 11
# texts as other programs write them, with blocks of a dump
TABLES = {
    "plain": ("t,x\n" + "".join(f"{k / 10},{k * k}\n" for k in range(6)), 0),
    "decimal comma": ("t;x\n0,5;-1,25\n1,0;2\n1,5;1e-3\n", 0),
    "units in a line": ("time;position;torque\nms;µm;mN·m\n0;1000;5\n1;2000;6\n2;3000;7\n", 0),
    "units in brackets": ("t [ms]\tx position [mm]\tspeed_rpm\n0\t1\t60\n1\t2\t120\n2\t3\t180\n", 0),
    "short names": ("Time, Position (actual), Torque\nms, mm, %\nT, P, M\n0, 1, 2\n1, 2, 3\n2, 3, 4\n", 0),
    "no heads": ("1 2 3\n4 5 6\n7 8 9\n", 0),
    "remarks, gaps, quotes": ('# made by hand\n"a";"b c"\n1;"2"\n;nan\n3;4\n', 0),
    "preamble": ("Model,Scope\nDate,2024-01-02\n\nSecond,Volt\n0.0,1.0\n0.1,2.0\n0.2,3.0\n", 0),
    "texts": ("name,x\none,1\ntwo,2\nthree,3\n", 0),
    "clock": ("time,x\n10:00:00.0,1\n10:00:00.5,2\n10:00:01.0,3\n", 0),
    "halscope": ("Sampling period is 1000000 ns\n X-pos 1.0 X-vel 2.0\n X-pos 1.5 X-vel 2.5\n X-pos 2.0 X-vel 3\n", 0),
    "halsampler": ("0 1.0 2.0\n1 1.5 2.5\n2 2.0 3.0\n", 0),
    "dump": ("1 2 3 4 5 6\n", 2),
    "dump of statements": ("TABLE(0,1,2,3)\nTABLE(3,4,5,6)\n", 2),
    "bars": ("a|b\n1|2\n3|4\n5|6\n", 0),
}
SOURCES = ("t", "t [ms]", "2[um]", "px*0.001", "pos/8192 rev", "I*0.0302 N·m", "TRQ[‰ of 1.27 N·m]", "t*2[s]")


def table_answer(text, blocks):
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "log.csv"
        file.write_text(text, encoding="utf-8")
        table = read_table(file, blocks)
        return {"columns": table.columns, "texts": table.texts, "period": table.period, "units": table.units}


def steps(identity):
    """Observations and rewards over some steps, alone; which numbers of a long observation change."""
    environment = gymnasium.make(identity)
    environment.action_space.seed(SEED)
    observation, info = environment.reset(seed=SEED)
    found = {"first": summed(observation), "steps": []}
    for _ in range(STEPS):
        observation, reward, ended, cut, info = environment.step(environment.action_space.sample())
        found["steps"].append([reward, ended, cut, summed(observation)])
        if ended or cut:
            break
    found["last info"] = numbers(info)
    environment.close()
    return found


def summed(observation):
    """Ends, sum and weighted sum of an observation's numbers, whatever its length."""
    flat = np.asarray(observation, float).ravel()
    weights = np.linspace(1, 2, flat.size)
    return [flat.size, *flat[:4].tolist(), float(flat.sum()), float((flat * weights).sum())]


def numbers(info):
    return {key: value for key, value in info.items() if isinstance(value, int | float | str | bool)}


# that of the bead width takes two seconds to begin
# not those that a test has registered in the same process
IDENTITIES = sorted(f"gantrysim/{task}" for task in TASKS if "BeadWidth" not in task)
CASES = {name: lambda name=name: steps(name) for name in IDENTITIES}
CASES |= {f"table, {name}": lambda given=given: table_answer(*given) for name, given in TABLES.items()}
CASES |= {f"source, {text}": lambda text=text: Source.parse("x", text) for text in SOURCES}
