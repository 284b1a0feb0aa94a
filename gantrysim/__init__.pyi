# The public names of gantrysim, and where each lives.
from . import controllers as controllers
from . import env as env
from . import faults as faults
from . import metrics as metrics
from . import render as render
from . import study as study
from .base.errors import GantryError as GantryError
from .base.errors import InputError as InputError
from .compare.runs.runs_page import compare_runs as compare_runs
from .engine.batch import simulate_batch as simulate_batch
from .engine.simulate import perfect_follower as perfect_follower
from .engine.simulate import simulate as simulate
from .glue.bead import Bead as Bead
from .glue.bead import BeadSettings as BeadSettings
from .glue.bead import HeightMap as HeightMap
from .glue.dispenser.dispenser import Dispenser as Dispenser
from .glue.dispenser.needle import Needle as Needle
from .glue.dispenser.syringe import Syringe as Syringe
from .job.causes import Causes as Causes
from .job.causes import causes_of as causes_of
from .job.job import Job as Job
from .job.tolerance import Tolerance as Tolerance
from .machine.axis import Axis as Axis
from .machine.machine import Machine as Machine
from .metrics.budget import Budget as Budget
from .record.run import Run as Run
from .record.run_file import Fault as Fault
from .record.setpoints import Setpoints as Setpoints
from .remedy.improve import improve as improve
from .report import plots as plots
from .report.saved import SavedRun as SavedRun
from .results.verdict import Verdict as Verdict
from .servo.laws.user import Tick as Tick
from .servo.servo import Servo as Servo
from .study import tuning as tuning

__version__: str
