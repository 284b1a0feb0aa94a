"""The greedy combination against all subsets of levers, each at every setting, on jobs that nothing makes pass."""

import pytest

from gantrysim.base.errors import GantryError
from gantrysim.remedy.bench import Bench
from gantrysim.remedy.improve import Search, improve
from gantrysim.remedy.lever import ROWS, State
from gantrysim.remedy.levers import LEVERS

from support.remedies import CIRCLE, FLOW, LAG, SIDES, lines_job, spiral_job

BETTER = 1.05  # least burden of all subsets, times this, at least that of the greedy combination

# tolerances that no combination keeps, so that the burdens are compared and not only passes
TIGHT_GLUE = {"bead_width": 0.5, "start_length": 0.3, "stop_length": 0.3}
TIGHT_PATH = {"path_max": 2e-3, "path_p95": 1e-3}
TIGHT_SPIRAL = {"path_max": 2e-2, "path_p95": 1e-2}
JOBS = {
    "sides": (
        lambda: lines_job(SIDES, dispenser={"flow": FLOW, **LAG}, tolerance=TIGHT_GLUE),
        ("flow by speed", "lag compensation", "leads", "acceleration", "slower"),
    ),
    "circle": (
        lambda: lines_job(CIRCLE, tolerance=TIGHT_PATH),
        ("friction compensation", "disturbance observer", "integral time", "loop gains", "slower"),
    ),
    "spiral": (
        lambda: spiral_job({"tolerance": TIGHT_SPIRAL}),
        ("acceleration", "loop period", "exact waits", "slower", "friction compensation"),
    ),
}


def all_states(state, levers):
    """Yield the state after every subset of levers at every setting, levers in their order."""
    if not levers:
        yield state
        return
    first, *others = levers
    yield from all_states(state, others)
    settings = first.settings(state)
    for setting in () if isinstance(settings, str) else settings:
        try:
            changed = State(state.job.changed(setting.changes), state.measure)
        except GantryError:
            continue
        yield from all_states(changed, others)


@pytest.mark.soak
@pytest.mark.parametrize("name", JOBS)
def test_no_subset_of_levers_is_much_better(name):
    build, names = JOBS[name]
    job = build()
    result = improve(job, levers=names, fastest=False)
    search = Search(job, Bench(job), ROWS)
    levers = [lever for lever in LEVERS if lever.name in names]
    burdens = [state.outcome.burden for state in all_states(search.start, levers)]
    assert len(burdens) > 100
    assert min(burdens) > 0
    assert result.after.burden <= BETTER * min(burdens)
