"""Search for the gains with the least error on several machines, and write them in a controller's parameters."""

from pathlib import Path

import gantrysim as gs
from gantrysim.exchange.gains import export_gains

BUDGET = 60  # runs of the search; 300 are the default of `gantrysim tune`

# 1. The job whose gains are searched, from the derived ones. LinuxCNC's PID has no notch, so the servo has none.
job = gs.Job.load("fanuc-spiral", ["servo.notch_frequency=0"])

# 2. The search: on the job's machine and on two others, drawn within the tolerances of motors and masses.
study = gs.tuning.TuningStudy(job, budget=BUDGET, robust=2, unseen=4, seed=1)
outcome = gs.study.run_study(study, Path("out/tuned"), workers=1)
for sentence in outcome.findings:
    print(sentence)

# 3. The best gains, and the run with them beside the run before.
tuned = study.history(outcome.rows).best.servo
before = job.run()
after = study.run(tuned)
for name, run in (("derived", before), ("tuned", after)):
    rms = gs.Budget(run).values.contour.rms
    print(f"{name} gains: contour error {1e3 * rms:.2f} µm rms")

# 4. The gains in LinuxCNC's parameters, and the settings that are not gains.
text, notes = export_gains("linuxcnc", job.built_machine.axes, tuned)
print(text)
for note in notes:
    print("note:", note)
