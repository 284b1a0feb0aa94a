"""Compare the search of `gantrysim tune` with Nelder-Mead, CMA-ES, differential evolution and TPE.

python scripts/compare_tuners.py [--jobs ...] [--starts ...] [--methods ...] [--seeds ...] [--budgets ...]

All methods minimise the same metric over the same coordinates with the same constraints, and only runs count: gains
that miss the margin are known without one. The value of a method is the metric of the best gains that it found within
the budget and that keep every limit, measured on all machines. Results are kept in results.csv, and every run in
runs-JOB.jsonl, so a comparison that was stopped resumes when rerun; delete both to compare anew after a change. With
--write, the results go to docs/tuning.csv, and their table replaces that between the markers in docs/tuning.md.
"""

import argparse
import csv
import itertools
import json
import math
from pathlib import Path

import numpy as np
from cmaes import CMA
from scipy.optimize import differential_evolution, minimize

from gantrysim import Job
from gantrysim.tuning import TuningStudy
from gantrysim.tuning.candidates import Candidate
from gantrysim.tuning.objective import RIPPLE, case_of, column, measure_together, trial_result
from gantrysim.tuning.search import box, candidate_at
from gantrysim.tuning.space import SEARCHED

JOBS = ("softmc-arc", "stage-outline", "fanuc-spiral")
STARTS = {  # factors on the derived gains
    "derived": {},
    "tenth": dict.fromkeys(SEARCHED, 0.1),
    "skewed": {"kp": 4.0, "ki": 0.2, "kd": 0.5, "velocity_ff": 0.0, "acceleration_ff": 2.0},
}
STEP = 0.3  # of the first points around the start, for every method that has one
WORSE = 10.0  # added to the logarithm of the metric for each rank below the first
BEYOND = 0.3  # bound of rho of the others: above 0 it counts as 0, so that they reach the edge of the margin
FREE = 20  # evaluations without a run, for each run of the budget
DOCS = Path(__file__).parent.parent / "docs"
BEGIN, END = "<!-- comparison -->", "<!-- end of comparison -->"

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--jobs", nargs="+", default=JOBS, help="built-in jobs or TOML files")
parser.add_argument("--starts", nargs="+", default=list(STARTS), choices=STARTS)
parser.add_argument("--methods", nargs="+", help="by default all")
parser.add_argument("--seeds", nargs="+", type=int, default=[1])
parser.add_argument("--budgets", nargs="+", type=int, default=[100, 300], help="runs")
parser.add_argument("--robust", type=int, default=0, help="perturbed machines besides the job's own")
parser.add_argument("--out", type=Path, default=Path("out/compare-tuners"))
parser.add_argument("--write", action="store_true", help="write docs/tuning.csv and the table in docs/tuning.md")


class BudgetSpentError(Exception):
    pass


class Runs:
    """Results of runs, each kept in a file as soon as it is made."""

    def __init__(self, path):
        text = path.read_text() if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]  # a stop may cut the last line
        if whole != text:
            path.write_text(whole)
        self.path, self.known = path, dict(map(json.loads, whole.splitlines()))

    def __call__(self, cases, metric):
        missing = {case.key: case for case in cases if case.key not in self.known}
        names = ("status", "fault_time_s", column(metric), RIPPLE)
        with self.path.open("a") as file:
            for key, row in zip(missing, measure_together(list(missing.values()), metric), strict=True):
                self.known[key] = {name: row[name] for name in names if name in row}
                file.write(json.dumps([key, self.known[key]]) + "\n")
        return [self.known[case.key] for case in cases]


class Objective:
    """The number that a method minimises at a point; counts the runs and keeps the best gains found with them."""

    def __init__(self, study, runs):
        self.study, self.runs, self.space, self.free = study, runs, study.space, 0
        self.trace, self.made = [], 0  # (runs made, metric of the best feasible gains)
        self.start, self.bounds, self.guess = box(self.space, study.stability)
        self.bounds[: self.space.groups, 1] = BEYOND
        self.low, self.high = self.bounds.T

    def __call__(self, point):
        point = np.asarray(point, float)
        candidate, self.guess = candidate_at(1, 1, self.space, self.study.stability, point, self.guess)
        if candidate.excess > 0:
            self.free += 1
            if self.free > FREE * self.study.budget:
                raise BudgetSpentError
            return 4 * WORSE + candidate.excess
        return self.run(candidate)

    def run(self, candidate):
        if self.made + self.study.robust + 1 > self.study.budget:
            raise BudgetSpentError
        cases = [case_of(self.study.job, candidate.servo, one) for one in self.study.perturbations]
        rows = self.runs(cases, self.study.metric)
        candidate.results.update(enumerate(trial_result(row, self.study.metric) for row in rows))
        self.made += len(cases)
        rank, amount = candidate.order(0.01 * self.study.ripple)
        if rank == 1 and (not self.trace or amount < self.trace[-1][1]):
            self.trace.append((self.made, amount))
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
    return TuningStudy(job.changed(gains), law="pid", budget=budget, robust=robust, unseen=0, seed=seed)


def of_other(method, study, runs):
    """Return the trace of another method."""
    value = Objective(study, runs)
    try:
        value.run(Candidate(0, 1, study.space.start, float(study.stability.excess(study.space.start).max())))
        OTHERS[method](value, study.seed)
    except BudgetSpentError:
        pass
    return value.trace


def of_own(study, runs):
    """Return the trace of gantrysim's own search, as the study makes it."""
    history = study.history_of(lambda cases: runs(cases, study.metric))
    ranked = [(one.runs, *one.order(0.01 * study.ripple)) for one in history.leaders]
    return [(made, metric) for made, rank, metric in ranked if rank == 1]


def value_at(trace, budget):
    return min((metric for made, metric in trace if made <= budget), default=math.inf)


def results_of(method, name, start, seed, budgets, robust, runs):
    """Return the metric of the best gains that a method found within each of the budgets."""
    if method == OWN:  # the others do not know their budget
        return {
            budget: value_at(of_own(study_of(name, start, seed, budget, robust), runs), budget) for budget in budgets
        }
    trace = of_other(method, study_of(name, start, seed, max(budgets), robust), runs)
    return {budget: value_at(trace, budget) for budget in budgets}


def table(rows):
    """Return the mean over the seeds as a Markdown table, a row for each job, start and budget."""
    found = {}
    for row in rows:
        budgets = found.setdefault((row["job"], row["start"]), {})
        budgets.setdefault(int(row["budget"]), {}).setdefault(row["method"], []).append(float(row["metric"]))
    lines = [
        f"| job | start | runs | {' | '.join((OWN, *OTHERS))} | {OWN} over the best other |",
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
    """Return a page with the table of rows between its markers."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}\n{table(rows)}\n{END}{rest.partition(END)[2]}"


COLUMNS = ("job", "start", "machines", "method", "seed", "budget", "metric")


def main(arguments):
    results = arguments.out / "results.csv"
    arguments.out.mkdir(parents=True, exist_ok=True)
    if not results.exists():
        results.write_text(",".join(COLUMNS) + "\n")
    with results.open(newline="") as file:
        done = list(csv.DictReader(file))
    made = {tuple(row.values())[:-1] for row in done}
    methods, seeds = arguments.methods or [OWN, *OTHERS], arguments.seeds
    for name in arguments.jobs:
        runs = Runs(arguments.out / f"runs-{Path(name).stem}.jsonl")
        for start, method, seed in itertools.product(arguments.starts, methods, seeds):
            keys = {b: tuple(map(str, (name, start, arguments.robust + 1, method, seed, b))) for b in arguments.budgets}
            left = [budget for budget, key in keys.items() if key not in made]
            if not left:
                continue
            found = results_of(method, name, start, seed, left, arguments.robust, runs)
            with results.open("a", newline="") as file:
                csv.writer(file).writerows([*keys[budget], metric] for budget, metric in found.items())
            done += [dict(zip(COLUMNS, (*keys[budget], metric), strict=True)) for budget, metric in found.items()]
            print(
                name,
                start,
                method,
                seed,
                *(f"{budget}: {metric:.4g} µm" for budget, metric in found.items()),
                flush=True,
            )
    shown = [
        row for row in done if int(row["machines"]) == arguments.robust + 1 and int(row["budget"]) in arguments.budgets
    ]
    if arguments.write:
        with (DOCS / "tuning.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(shown)
        page = DOCS / "tuning.md"
        page.write_text(with_table(page.read_text(encoding="utf-8"), shown), encoding="utf-8")
    print(table(shown))


if __name__ == "__main__":
    main(parser.parse_args())
