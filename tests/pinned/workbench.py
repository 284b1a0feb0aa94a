"""What the workbench answers to a page's orders, without a browser: controls, rows, refusals, saved files."""

import tempfile
from functools import cache
from pathlib import Path

from pinned.runs import digits

from gantrysim import InputError, Job
from gantrysim.live.controls import checked_values, controls_of
from gantrysim.live.draft import Draft, Refusal
from gantrysim.live.store import Store, is_trace
from gantrysim.live.studio import Studio
from gantrysim.live.workbench import Workbench
from gantrysim.live.worker import Message

from support.live_jobs import TEXT

JOB = (
    'name = "short"\nmachine = "xy"\n[program]\nfile = "part.ngc"\nacceleration = 2000.0\n'
    "[dispenser]\nflow = 200.0\n[servo]\nintegral_time = 0.03\n"
)
FILES = {
    "short.toml": JOB,
    "part.ngc": TEXT,
    "machine.toml": 'name = "soft"\n[x]\ntravel = [0, 1]\n',
    "notes.md": "# notes\n",
    "points.csv": "x,y\n0,0\n1,0\n",
}


class Session:
    """A workbench whose worker answers in this thread, and at once: of a run, the quick answer alone."""

    def __init__(self, folder):
        for name, text in FILES.items():
            (folder / name).write_text(text, encoding="utf-8")
        scratch = folder / "scratch"
        scratch.mkdir()
        self.folder = folder
        self.studio = Studio(scratch)
        self.told = []
        self.saved = []
        self.store = Store(folder, scratch)
        self.bench = Workbench(self.store, str(folder / "short.toml"), self.ask, self.tell)

    def tell(self, kind, content):
        self.told.append((kind, content))

    def ask(self, request):
        if request.draft is None or request.task == "stop":
            return
        self.studio.newest = request.number

        def send(kind, content):
            self.bench.receive(Message(request.number, kind, content))
            if kind == "result":
                # nobody waits for the whole answer
                self.studio.newest = -1

        self.studio.answer(request, send)
        self.bench.receive(Message(request.number, "done", {}))

    def do(self, order):
        """What an order changes: the state, values of controls, rows of the verdict, or why it is refused."""
        before = dict(self.bench.state())
        values = self.values()
        self.told.clear()
        try:
            self.bench.do(order)
        except InputError as error:
            return str(error).replace(f"{self.folder}/", "")
        after = self.bench.state()
        kinds = [kind for kind, _ in self.told if kind not in ("state", "progress")]
        answer = {
            "state": {key: plain(after[key], self.folder) for key in after if after[key] != before[key]},
            "values": {key: value for key, value in self.values().items() if values.get(key) != value},
            "told": kinds,
        }
        refused = [content for kind, content in self.told if kind == "refused"]
        if refused:
            return answer | {"refused": [plain(list(content.values()), self.folder) for content in refused]}
        if "result" in kinds:
            head = self.bench.head
            answer["verdict"] = [head["engine"], head["headline"], digits(head["time"])]
            answer["rows"] = [" ".join([row["name"], row["state"], *row["texts"]]) for row in head["rows"]]
            answer["kept"] = head.get("kept", {}).get("headline", "")
        return answer

    def values(self):
        messages = dict(self.bench.messages())
        return {control["key"]: control["value"] for control in messages.get("controls", {}).get("controls", ())}


def plain(value, folder):
    if isinstance(value, dict):
        return {key: plain(item, folder) for key, item in value.items()}
    if isinstance(value, list):
        return [plain(item, folder) for item in value]
    return value.replace(f"{folder}", "FOLDER") if isinstance(value, str) else value


ORDERS = {
    "speed": {"do": "set", "values": {"override": 50.0}},
    "acceleration": {"do": "set", "values": {"program.acceleration": 500.0}},
    "undo": {"do": "undo"},
    "redo": {"do": "redo"},
    "redo of nothing": {"do": "redo"},
    "drag": {"do": "set", "values": {"servo.damping": 0.9}, "dragging": True},
    "drag on": {"do": "set", "values": {"servo.damping": 0.6}, "dragging": True},
    "drop": {"do": "set", "values": {"servo.damping": 0.5}},
    "undo of a drag": {"do": "undo"},
    "keep": {"do": "keep", "on": True},
    "law": {"do": "set", "values": {"servo.law": ["pid", "friction"]}},
    "let go": {"do": "keep"},
    "own law": {"do": "set", "values": {"servo.law": None}},
    "beyond": {"do": "set", "values": {"servo.damping": 2.5}},
    "a text": {"do": "set", "values": {"servo.damping": "high"}},
    "no control": {"do": "set", "values": {"program.controller": "own.py:Own"}},
    "a machine": {"do": "set", "values": {"machine": "xyz"}},
    "a lost machine": {"do": "set", "values": {"machine": "own.toml"}},
    "a law that there is not": {"do": "set", "values": {"servo.law": ["pid", "own.py:Law"]}},
    "no law": {"do": "set", "values": {"servo.law": []}},
    "no table": {"do": "set", "values": [1]},
    "wrong program": {"do": "program", "text": "G21\nF600\nG1 X10\nG1 Q7\nM2\n"},
    "save while refused": {"do": "save", "name": "saved"},
    "right program": {"do": "program", "text": "G21\nF3000\nG1 X10\nM2\n"},
    "save": {"do": "save", "name": "saved"},
    "save again": {"do": "save", "name": "saved.toml"},
    "save elsewhere": {"do": "save", "name": "../saved"},
    "unsave": {"do": "unsave"},
    "unsave again": {"do": "unsave"},
    "wrong job": {"do": "job", "text": 'name = "a"\n[program\n'},
    "unknown key": {"do": "job", "text": 'name = "a"\nmachin = "xy"\n'},
    "reset": {"do": "reset"},
    "another file": {"do": "open", "kind": "folder", "name": "part.ngc"},
    "a file that there is not": {"do": "open", "kind": "folder", "name": "../part.ngc"},
    "a built-in job that there is not": {"do": "open", "kind": "built-in", "name": "an226"},
    "no kind": {"do": "open", "kind": "web", "name": "an225"},
    "columns of nothing": {"do": "columns", "columns": "time=t"},
    "a proposal of none": {"do": "try", "number": 0},
    "stop": {"do": "stop"},
    "no order": {"do": "format"},
    "nothing": {},
    "a long text": {"do": "program", "text": 7},
}


@cache
def session_answers():
    with tempfile.TemporaryDirectory() as folder:
        session = Session(Path(folder).resolve())
        session.bench.start()
        answers = {"begin": plain(session.bench.state(), session.folder)}
        for name, order in ORDERS.items():
            answers[name] = session.do(order)
            if name == "save":
                session.saved = (session.folder / "saved.toml").read_text(encoding="utf-8").splitlines()[:4]
        answers["files"] = sorted(file.name for file in session.folder.iterdir())
        answers["saved"] = session.saved
    return answers


def controls(name, override=100.0, **values):
    """The controls of a job: value, initial one, bounds, and what may be chosen."""
    opened = Job.load(name)
    job = opened.changed(values) if values else opened
    return [
        [
            control.key,
            control.label,
            control.value,
            control.initial,
            control.low,
            control.high,
            control.is_ratio,
            len(control.options) + len(control.additions),
        ]
        for control in controls_of(job, opened, override)
    ]


def checked():
    job = Job.load("an225")
    known = controls_of(job, job, 100.0)
    bounds = {control.key: (control.low, control.high) for control in known}
    low, high = bounds["servo.damping"]
    values = {
        "lowest": {"servo.damping": low},
        "highest": {"servo.damping": high},
        "below": {"servo.damping": low - 1e-6},
        "above": {"servo.damping": high + 1e-6},
        "true": {"servo.damping": True},
        "not a number": {"servo.damping": float("nan")},
        "laws twice": {"servo.law": ["pid", "friction", "friction"]},
        "an addition alone": {"servo.law": ["friction"]},
        "restored": {"servo.damping": None},
    }
    return {name: refusal(lambda given=given: checked_values(given, known)) for name, given in values.items()}


def refusal(answer):
    try:
        return answer()
    except InputError as error:
        return str(error)


def refusals():
    texts = (
        "part.ngc: line 12: 'G7' is no code",
        "line 3: X-4.5 is too far",
        "no line",
        "at line 7, column 2",
        "it's line 9: F0",
    )
    return [list(Refusal.of(InputError(text))) for text in texts]


TRACES = {
    "log.csv": "t,x\n" + "".join(f"{k},{k}\n" for k in range(8)),
    "short.csv": "t,x\n" + "".join(f"{k},{k}\n" for k in range(7)),
    "points.csv": "x,y\n" + "".join(f"{k},{k}\n" for k in range(9)),
    "links.csv": "encoder_x,y\n" + "".join(f"{k},{k}\n" for k in range(9)),
    "falling.csv": "time,x\n" + "".join(f"{-k},{k}\n" for k in range(9)),
    "log.txt": "t\tx\n" + "".join(f"{k}\t{k}\n" for k in range(9)),
    "one.txt": "t\n" + "".join(f"{k}\n" for k in range(9)),
    "part.ngc": TEXT,
    "run.npz": "PK",
    "short.toml": JOB,
    "letter.txt": "Dear reader\n",
}


def traces():
    return {name: is_trace(name, text.encode()) for name, text in TRACES.items()}


def drafts():
    """Texts of drafts, and how they differ from their files."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder).resolve()
        for name, text in FILES.items():
            (place / name).write_text(text, encoding="utf-8")
        path = str(place / "short.toml")
        edited = Draft(path, text=JOB.replace('name = "', 'name = "the '))
        opened = edited.opened(place, allow_code=False)
        fast = Draft(path, override=250.0)
        job = fast.job(fast.opened(place, allow_code=False))
        return {
            "edited": [opened.name, opened.program["controller"], edited.name],
            "override": [job.controller.programmed_speed, Job.load(path).controller.programmed_speed],
            "texts": [
                Draft(path).file_text() == JOB,
                Draft(str(place / "part.ngc")).file_text(),
                Draft("an225").code(),
            ],
            "lost": refusal(lambda: Draft("lost.toml").file_text()),
            "names": Store(place, place).names()["folder"],
        }


CASES = {
    **{f"order, {name}": lambda name=name: session_answers()[name] for name in ("begin", *ORDERS, "files", "saved")},
    **{f"controls, {name}": lambda name=name: controls(name) for name in ("an225", "softmc-arc", "slicer-square")},
    "controls, changed": lambda: controls(
        "fanuc-spiral", 80.0, **{"servo.damping": 3.0, "program.blend_time": 0.3, "program.placement.x": 5.0}
    ),
    "checked": checked,
    "refusals": refusals,
    "traces": traces,
    "drafts": drafts,
}
