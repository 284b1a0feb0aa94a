"""Compare the search of `gantrysim tune` with Nelder-Mead, CMA-ES, differential evolution and TPE.

python scripts/compare_tuners.py [--jobs ...] [--starts ...] [--methods ...] [--seeds ...] [--budgets ...]
python scripts/compare_tuners.py --cpu SECONDS ... [--jobs ...] [--methods ...] [--seeds ...]

All methods minimise the same metric over the same coordinates with the same constraints. The value of a method is the
metric of the best gains that it found within the budget and that keep every limit, measured on all machines.

By default only runs count: gains that miss the margin are known without one. With --cpu the budget is CPU time of the
process: simulations, margins, and the method's own computations. The cases are then those of CASES, and every method
is given the derived gains besides the start, both at the edge of the margin: it begins at the better of them.

Results are kept in results.csv or cpu.csv, and every run with its CPU time in runs-JOB.jsonl, so a comparison that was
stopped resumes when rerun; delete them to compare anew after a change. With --write, the results replace the rows of
the same kind of budget in docs/tuning.csv, and their table that between the markers in docs/tuning.md.
"""

import argparse
import csv
import itertools
import json
import math
import os
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: idle threads of small products would count as CPU

import numpy as np
from cmaes import CMA
from scipy.optimize import differential_evolution, minimize

from gantrysim import Job
from gantrysim.study.tuning import TuningStudy
from gantrysim.study.tuning.candidates import Candidate
from gantrysim.study.tuning.objective import RIPPLE, case_of, column, measure_together, trial_result
from gantrysim.study.tuning.search import MarginEdge, box, candidate_at
from gantrysim.study.tuning.space import SEARCHED_GAINS

JOBS = ("softmc-arc", "stage-outline", "fanuc-spiral")
STARTS = {  # factors on the derived gains
    "derived": {},
    "tenth": dict.fromkeys(SEARCHED_GAINS, 0.1),
    "skewed": {"kp": 4.0, "ki": 0.2, "kd": 0.5, "velocity_ff": 0.0, "acceleration_ff": 2.0},
    "soft": {"kp": 0.3, "kd": 2.0},
    "stiff": {"kp": 3.0, "kd": 1.5},
    "undamped": {"kd": 0.4},
    "bare": {"ki": 3.0, "velocity_ff": 0.0, "acceleration_ff": 0.0},
}
TABLE = ("derived", "tenth", "skewed")  # starts of the comparison by runs
CASES = (  # job and start of the comparison by CPU time; none is in that by runs
    ("trio-basic", "soft"),
    ("delta-arc", "soft"),
    ("softmc-helical", "skewed"),
    ("softmc-basic", "undamped"),
    ("an225", "stiff"),
    ("an225-3d", "bare"),
    ("fanuc-conical", "bare"),
    ("linuxcnc-flanges", "tenth"),
    ("slicer-square", "undamped"),
    ("svg-gasket", "stiff"),
)
METRICS = {"an225": "servo_rms", "an225-3d": "servo_rms"}  # whose contour error is the program's, 425 µm
STEP = 0.3  # of the first points around the start, for every method that has one
WORSE = 10.0  # added to the logarithm of the metric for each rank below the first
BEYOND = 0.3  # bound of rho of the others: the edge of the margin, at 0, is inside, and beyond it nothing is run
UNLIMITED = 10**9  # runs, where CPU time is the limit
FREE = 20  # evaluations without a run, for each run of the budget
DOCS = Path(__file__).parent.parent / "docs"
RUNS, CPU = KINDS = "runs", "cpu_s"  # of a budget
BEGIN = {RUNS: "<!-- comparison -->", CPU: "<!-- comparison by CPU time -->"}
END = "<!-- end of comparison -->"
COLUMNS = ("job", "start", "machines", "method", "seed", "kind", "budget", "metric")

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--jobs", nargs="+", help="built-in jobs or TOML files")
parser.add_argument("--starts", nargs="+", choices=STARTS)
parser.add_argument("--methods", nargs="+", help="by default all")
parser.add_argument("--seeds", nargs="+", type=int, default=[1])
parser.add_argument("--budgets", nargs="+", type=int, default=[100, 300], help="runs")
parser.add_argument("--cpu", nargs="+", type=int, help="CPU time, in place of runs [s]")
parser.add_argument("--robust", type=int, default=0, help="perturbed machines besides the job's own")
parser.add_argument("--out", type=Path, default=Path("out/compare-tuners"))
parser.add_argument("--write", action="store_true", help="write docs/tuning.csv and the table in docs/tuning.md")


class BudgetSpentError(Exception):
    pass


class Clock:
    """CPU time since it was started: of this process, with the recorded time of each run in place of its own."""

    def __init__(self):
        self.correction = -time.process_time()

    def __call__(self):
        return time.process_time() + self.correction


class Runs:
    """Results of runs, each kept in a file with its CPU time as soon as it is made; `clock` counts them."""

    def __init__(self, path):
        text = path.read_text() if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]  # a stop may cut the last line
        if whole != text:
            path.write_text(whole)
        self.path, self.known = path, dict(map(json.loads, whole.splitlines()))
        self.clock = Clock()

    def __call__(self, cases, metric):
        begin = time.process_time()
        rows = self._rows(cases, metric)
        self.clock.correction += sum(row["cpu_s"] for row in rows) - (time.process_time() - begin)
        return rows

    def _rows(self, cases, metric):
        missing = {case.key: case for case in cases if case.key not in self.known}
        names = ("status", "fault_time_s", column(metric), RIPPLE)
        begin = time.process_time()
        rows = measure_together(list(missing.values()), metric)
        share = (time.process_time() - begin) / max(len(missing), 1)
        with self.path.open("a") as file:
            for key, row in zip(missing, rows, strict=True):
                self.known[key] = {**{name: row[name] for name in names if name in row}, "cpu_s": share}
                file.write(json.dumps([key, self.known[key]]) + "\n")
        return [self.known[case.key] for case in cases]


class Objective:
    """The number that a method minimises at a point; keeps the best gains found, and what was spent until then."""

    def __init__(self, study, runs, seconds):
        self.study, self.runs, self.space, self.free = study, runs, study.space, 0
        self.seconds = seconds  # limit of the CPU time, or None: runs count
        self.trace, self.made = [], 0  # (runs made or CPU time, metric of the best feasible gains)
        self.edge = MarginEdge(self.space, study.stability)
        self.start, self.bounds = box(self.edge)
        self.bounds[: self.space.groups, 1] = BEYOND
        self.low, self.high = self.bounds.T

    def __call__(self, point):
        self.check()
        point = np.asarray(point, float)
        candidate = candidate_at(1, 1, self.edge, point)
        if candidate.excess > 0:
            self.free += 1
            if self.seconds is None and self.free > FREE * self.study.budget:
                raise BudgetSpentError
            return 4 * WORSE + candidate.excess
        return self.run(candidate)

    def check(self):
        if self.seconds is not None and self.runs.clock() > self.seconds:
            raise BudgetSpentError

    def begin_at_the_better(self):
        """Move the start to the derived gains where these are better, both at the edge of the margin."""
        edges = np.zeros((2, len(self.start)))
        edges[0, self.space.groups :] = self.start[self.space.groups :]
        edges[1, self.space.groups :] = self.space.natural
        self.start = edges[np.argmin([self(edge) for edge in edges])]

    def run(self, candidate):
        if self.made + self.study.robust + 1 > self.study.budget:
            raise BudgetSpentError
        cases = [case_of(self.study.job, candidate.servo, one) for one in self.study.perturbations]
        rows = self.runs(cases, self.study.metric)
        candidate.results.update(enumerate(trial_result(row, self.study.metric) for row in rows))
        self.made += len(cases)
        rank, amount = candidate.order(0.01 * self.study.ripple)
        if rank == 1 and (not self.trace or amount < self.trace[-1][1]):
            self.trace.append((self.made if self.seconds is None else self.runs.clock(), amount))
        return math.log(amount) if rank == 1 else (rank - 1) * WORSE + amount


def nelder_mead(value, seed):
    signs = (
        np.random.default_rng(seed).choice([-1.0, 1.0], len(value.start)) if seed > 1 else -np.ones(len(value.start))
    )
    best = value.start
    while True:  # restarted where it has converged
        far = best + np.diag(STEP * signs)
        simplex = np.clip(np.vstack([best, far]), value.low, value.high)
        own = {"initial_simplex": simplex, "xatol": 0.003, "fatol": 1e-3, "maxfev": 10**6, "maxiter": 10**6}
        best = minimize(value, best, method="Nelder-Mead", bounds=value.bounds, options=own).x
        signs = -signs


def cma_es(value, seed):
    optimiser = CMA(value.start, STEP, bounds=value.bounds, seed=seed)
    while True:
        points = [optimiser.ask() for _ in range(optimiser.population_size)]
        optimiser.tell([(point, value(point)) for point in points])


def evolution(value, seed):
    differential_evolution(value, value.bounds, x0=value.start, rng=seed, popsize=5, maxiter=10**6, tol=0, polish=False)


def tpe(value, seed):
    import optuna

    optuna.logging.set_verbosity(optuna.logging.CRITICAL)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed))
    names = [f"x{k}" for k in range(len(value.start))]
    study.enqueue_trial(dict(zip(names, value.start.tolist(), strict=True)))
    study.optimize(lambda trial: value([trial.suggest_float(n, *b) for n, b in zip(names, value.bounds, strict=True)]))


OTHERS = {"Nelder-Mead": nelder_mead, "CMA-ES": cma_es, "differential evolution": evolution, "TPE": tpe}
OWN = "gantrysim tune"


def study_of(name, start, seed, budget, robust):
    job = Job.load(name)
    servo = job.built_servo
    gains = {f"servo.{gain}": [f * g for g in servo.per_axis(gain)] for gain, f in STARTS[start].items()}
    metric = METRICS.get(name, "contour_rms")
    return TuningStudy(job.changed(gains), "pid", metric, budget=budget, robust=robust, unseen=0, seed=seed)


def of_other(method, study, runs, seconds=None):
    """Return the trace of another method, within the study's runs or so many seconds."""
    value = Objective(study, runs, seconds)
    try:
        value.run(Candidate(0, 1, study.space.start, float(study.stability.excess(study.space.start).max())))
        if seconds is not None:
            value.begin_at_the_better()
        OTHERS[method](value, study.seed)
    except BudgetSpentError:
        pass
    return value.trace


def of_own(study, runs):
    """Return the trace of gantrysim's own search, as the study makes it."""
    history = study.history_of(lambda cases: runs(cases, study.metric))
    ranked = [(one.runs, *one.order(0.01 * study.ripple)) for one in history.leaders]
    return [(made, metric) for made, rank, metric in ranked if rank == 1]


def of_own_in_time(study, runs, seconds):
    """Return the trace of gantrysim's own search within so many seconds."""
    trace = []
    end = 0.0  # of the last runs

    def note():
        for leader in study.leaders[-1:]:
            rank, metric = leader.order(0.01 * study.ripple)
            if rank == 1:
                trace.append((end, metric))

    def measure(cases):
        nonlocal end
        note()
        if runs.clock() > seconds:
            raise BudgetSpentError
        rows = runs(cases, study.metric)
        end = runs.clock()
        return rows

    try:
        study.history_of(measure)
        note()
    except BudgetSpentError:
        pass
    return trace


def value_at(trace, budget):
    return min((metric for spent, metric in trace if spent <= budget), default=math.inf)


def results_of(method, case, budgets, arguments, runs):
    """Return the metric of the best gains that a method found within each of the budgets."""
    name, start, seed = case
    most = max(budgets)
    if arguments.cpu:
        study = study_of(name, start, seed, UNLIMITED, arguments.robust)
        study.stability.excess(study.space.start)
        measure_together([case_of(study.job, study.space.start, None)], study.metric)  # compiles and loads
        runs.clock = Clock()
        trace = of_own_in_time(study, runs, most) if method == OWN else of_other(method, study, runs, most)
        return {budget: value_at(trace, budget) for budget in budgets}
    if method == OWN:  # the others do not know their budget
        return {
            budget: value_at(of_own(study_of(name, start, seed, budget, arguments.robust), runs), budget)
            for budget in budgets
        }
    trace = of_other(method, study_of(name, start, seed, most, arguments.robust), runs)
    return {budget: value_at(trace, budget) for budget in budgets}


def table(rows):
    """Return the mean over the seeds as a Markdown table, a row for each job, start and budget of one kind."""
    found = {}
    for row in rows:
        budgets = found.setdefault((row["job"], row["start"]), {})
        budgets.setdefault(int(row["budget"]), {}).setdefault(row["method"], []).append(float(row["metric"]))
    unit = {RUNS: "runs", CPU: "CPU time [s]"}[rows[0]["kind"]] if rows else "budget"
    lines = [
        f"| job | start | {unit} | {' | '.join((OWN, *OTHERS))} | {OWN} over the best other |",
        "|---|---|---|" + "---|" * (len(OTHERS) + 2),
    ]
    for (job, start), budgets in found.items():
        for budget, metrics in sorted(budgets.items()):
            means = [np.mean(metrics.get(method, [math.nan])) for method in (OWN, *OTHERS)]
            share = means[0] / np.nanmin(means[1:]) if np.isfinite(means[1:]).any() else math.nan
            cells = ["" if math.isnan(mean) else f"{mean:.2f}" if math.isfinite(mean) else "none" for mean in means]
            cells.append("" if math.isnan(share) else f"{share:.2f}")
            lines.append(f"| `{job}` | {start} | {budget} | {' | '.join(cells)} |")
    return "\n".join(lines)


def with_table(page, rows):
    """Return a page with the table of rows, all of one kind of budget, between its markers."""
    begin = BEGIN[rows[0]["kind"]]
    before, _, rest = page.partition(begin)
    return f"{before}{begin}\n{table(rows)}\n{END}{rest.partition(END)[2]}"


def write_docs(rows):
    """Replace the rows of one kind of budget in docs/tuning.csv, and their table in docs/tuning.md."""
    with (DOCS / "tuning.csv").open(newline="") as file:
        others = [row for row in csv.DictReader(file) if row["kind"] != rows[0]["kind"]]
    with (DOCS / "tuning.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(sorted([*others, *rows], key=lambda row: KINDS.index(row["kind"])))
    page = DOCS / "tuning.md"
    page.write_text(with_table(page.read_text(encoding="utf-8"), rows), encoding="utf-8")


def cases_of(arguments):
    """Return the pairs of job and start to be compared."""
    if not arguments.cpu or arguments.starts:
        return list(itertools.product(arguments.jobs or JOBS, arguments.starts or TABLE))
    return [case for case in CASES if not arguments.jobs or case[0] in arguments.jobs]


def main(arguments):
    kind = CPU if arguments.cpu else RUNS
    budgets = arguments.cpu or arguments.budgets
    results = arguments.out / ("cpu.csv" if arguments.cpu else "results.csv")
    arguments.out.mkdir(parents=True, exist_ok=True)
    if not results.exists():
        results.write_text(",".join(COLUMNS) + "\n")
    with results.open(newline="") as file:
        done = list(csv.DictReader(file))
    known = {tuple(row.values())[:-1] for row in done}
    methods = arguments.methods or [OWN, *OTHERS]
    for (name, start), method, seed in itertools.product(cases_of(arguments), methods, arguments.seeds):
        keys = {b: tuple(map(str, (name, start, arguments.robust + 1, method, seed, kind, b))) for b in budgets}
        missing = [budget for budget, key in keys.items() if key not in known]
        if not missing:
            continue
        runs = Runs(arguments.out / f"runs-{Path(name).stem}.jsonl")
        found = results_of(method, (name, start, seed), missing, arguments, runs)
        with results.open("a", newline="") as file:
            csv.writer(file).writerows([*keys[budget], metric] for budget, metric in found.items())
        done += [dict(zip(COLUMNS, (*keys[budget], metric), strict=True)) for budget, metric in found.items()]
        print(name, start, method, seed, *(f"{b}: {metric:.4g} µm" for b, metric in found.items()), flush=True)
    machines = str(arguments.robust + 1)
    shown = [row for row in done if row["machines"] == machines and int(row["budget"]) in budgets]
    if arguments.write:
        write_docs(shown)
    print(table(shown))


if __name__ == "__main__":
    main(parser.parse_args())
