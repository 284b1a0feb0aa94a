"""Run a G-code file of your own: what was chosen for it, the verdict, and what to change."""

import sys
from pathlib import Path

import gantrysim as gs

SEAL = """\
(a seal around a bracket, 120 x 70 mm)
G21 G90 G64 P0.05
G0 Z5
G0 X20 Y20
G1 Z0.5 F600
G1 X120 F1800
G3 X130 Y30 I0 J10
G1 Y80
G3 X120 Y90 I-10 J0
G1 X20
G3 X10 Y80 J-10
G1 Y30
G3 X20 Y20 I10
G0 Z5
M30
"""

# 1. Your file, `python own_gcode.py part.ngc`, or the seal above.
if len(sys.argv) > 1:
    file = Path(sys.argv[1])
else:
    file = Path("seal.ngc")
    file.write_text(SEAL, encoding="utf-8")

# 2. Machine, servo and glue are chosen where nothing is given; the first note says what was.
job = gs.Job.load(file)
print(job.notes[0])

# 3. Run it. What prints is the verdict, row by row, and the facts.
run = job.run()
print(run)

# 4. What to change so that it passes: levers are simulated, and the lines to paste are printed.
print(gs.improve(job))

# 5. The page of the run: bead, path, errors and program with one cursor.
run.report("out/own-gcode")
print("page: out/own-gcode/report.html")
