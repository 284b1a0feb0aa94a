// The workbench: a job is edited, simulated and judged while one watches.

import { element, within } from "../../report/web/dom.js";
import { Controls } from "./controls.js";
import { Editor } from "./editor.js";
import { Link } from "./link.js";
import { proposalTable, showVerdict, verdictRow } from "./panels.js";
import { Views } from "./views.js";

const SEEN = "gantrysim-live-seen";
const GROUPS = { folder: "in this folder", dropped: "dropped", "built-in": "built-in" };
const RECORD = "run.npz"; // of the folder of a run
const FORMER = "former value shown; computing"; // the end is cut off where there is little room

/**
 * The element of an id.
 *
 * @template {string} Id
 * @param {Id} id
 * @returns {Id extends keyof PageElements ? PageElements[Id] : HTMLElement}
 */
const at = (id) => /** @type {any} */ (document.getElementById(id));

/** Write a text, unless it stands there: the browser would lay it out again. @param {HTMLElement} place @param {string} text */
function write(place, text) {
  if (place.textContent !== text) place.textContent = text;
}

/** @param {string} order */
const buttonOf = (order) => /** @type {HTMLButtonElement} */ (within(document, `[data-do="${order}"]`));

class Workbench {
  constructor() {
    /** @type {Partial<State>} */
    this.state = { number: -1 };
    this.listed = "";
    this.shown = -1; // number of the request whose result is shown
    /** @type {Head | null} */
    this.head = null;
    this.waiting = false; // for the answer to a slider, until which the next value waits
    this.next = null;
    this.controls = new Controls(at("controls"), (values, dragging) => this.set(values, dragging));
    const places = { readout: at("readout"), views: at("views"), strips: at("strips") };
    this.views = new Views(places, (line) => this.editor.setLine(line), this.controls);
    this.editor = new Editor(
      { choices: at("texts"), title: at("program-title"), editor: at("editor") },
      (kind, text) => this.order({ do: kind, text }),
      (line) => this.views.chooseLine(line),
    );
    this.link = new Link({
      found: () => this.connected(true),
      lost: () => this.connected(false),
      state: (state) => this.setState(state),
      text: (texts) => this.editor.show(texts),
      controls: ({ controls }) => this.controls.show(controls),
      margins: ({ row }) => this.margins(row),
      progress: (progress) => this.progress(progress),
      compiling: ({ text }) => this.say((this.compiling = text)),
      proposals: (proposals) => this.proposals(proposals),
      written: ({ folder, page }) => this.say(`written to ${page || folder}`),
      film: (film) => this.film(film),
      refused: (refusal) => this.refused(refusal),
      remark: ({ text }) => this.remark(text),
      result: (head, content, bytes) => this.result(head, content, bytes),
    });
    this.listen();
  }

  /** @param {object} order */
  order(order) {
    this.link.send(order);
  }

  /**
   * Send values; while a slider is dragged the next one waits for the answer, and only the last counts.
   *
   * @param {Record<string, unknown>} values @param {boolean} dragging
   */
  set(values, dragging) {
    if (dragging && this.waiting) {
      this.next = values;
      return;
    }
    this.next = null;
    this.waiting = true;
    performance.mark("value-sent");
    this.order({ do: "set", values, dragging });
  }

  answered() {
    this.waiting = false;
    if (this.next) this.set(this.next, true);
  }

  /** @param {boolean} isThere */
  connected(isThere) {
    at("lost").hidden = isThere;
    at("lost").textContent = isThere ? "" : "The server is gone: nothing is computed. Start gantrysim live again; this page tries to reconnect.";
    at("bench").inert = !isThere;
  }

  /** @param {State} state */
  setState(state) {
    const listed = JSON.stringify([state.jobs, state.path]);
    if (listed !== this.listed) this.jobs(state);
    this.listed = listed;
    const before = this.state;
    this.state = state;
    const enabled = { undo: state.can_undo, redo: state.can_redo, reset: state.changed };
    for (const [name, can] of Object.entries(enabled)) buttonOf(name).disabled = !can;
    at("keep").setAttribute("aria-pressed", String(state.kept));
    const unsave = buttonOf("unsave");
    unsave.hidden = !state.saved;
    unsave.title = `put back what stood in ${state.saved}`;
    at("beside").hidden = !state.beside;
    if (state.beside && JSON.stringify(state.beside) !== JSON.stringify(before.beside)) this.laidBeside(state.beside);
    write(at("former"), state.filmed ? "" : "of a former value");
    write(at("where"), `in ${state.folder}`);
    this.linkFilm();
    at("work").hidden = !state.busy;
    if (state.busy !== before.busy) {
      // a bar without a value moves on its own, and each of its frames takes time from the simulation
      at("progress").value = 0;
      write(at("task"), state.busy === "show" ? "" : state.busy);
    }
    if (!state.busy && this.stale) this.answered();
    this.paintStale();
  }

  get stale() {
    return this.state.busy === "show" && this.shown !== this.state.number;
  }

  paintStale() {
    at("bench").classList.toggle("stale", this.stale);
    at("verdict").setAttribute("aria-busy", String(this.stale));
    if (this.stale) this.say(FORMER);
    else if ([FORMER, this.compiling].includes(at("status").textContent)) this.say("");
  }

  /** @param {State} state */
  jobs({ jobs, path }) {
    const groups = Object.entries(GROUPS).filter(([kind]) => jobs[kind].length);
    const options = groups.map(([kind, label]) =>
      element("optgroup", { label }, ...jobs[kind].map((name) => element("option", { value: JSON.stringify({ kind, name }) }, name))),
    );
    at("jobs").replaceChildren(...options);
    const name = path.split(/[\\/]/).pop();
    const all = [...at("jobs").options].filter((option) => option.textContent === name);
    const inFolder = path.includes("/") || path.includes("\\");
    const chosen = all.find((option) => (JSON.parse(option.value).kind === "built-in") !== inFolder);
    if (chosen) chosen.selected = true;
  }

  /** @param {RowContent} row */
  margins(row) {
    const present = document.querySelector('[data-row="stability"]');
    const kept = this.head?.kept?.rows.find(({ name }) => name === row.name);
    if (present) present.replaceWith(verdictRow(row, kept));
  }

  /** @param {{ share: number, task: string }} progress */
  progress({ share, task }) {
    at("progress").value = share;
    write(at("task"), task);
  }

  /** @param {Head} head @param {RunContent | ComparedContent} content @param {number} bytes */
  result(head, content, bytes) {
    this.head = head;
    this.shown = head.number;
    this.refused(null);
    showVerdict(at("verdict"), head);
    if (head.beside) this.difference(head.beside);
    document.title = `${head.headline.slice(0, 1)} ${head.name}, gantrysim live`;
    this.views.show(content, head);
    at("bench").dataset.engine = head.engine;
    at("bench").dataset.bytes = String(bytes);
    at("bench").dataset.number = String(head.number);
    performance.mark("result-shown");
    this.paintStale();
    this.answered();
  }

  /** @param {BesideState} beside */
  laidBeside({ name, columns, period }) {
    at("beside-title").textContent = `Beside: ${name}`;
    at("difference").textContent = "comparing …";
    at("notes").replaceChildren();
    at("columns").value = columns;
    at("period").value = String(period ?? "");
  }

  /** @param {BesideContent} beside */
  difference({ sentence, notes, failed }) {
    at("difference").textContent = sentence;
    at("difference").classList.toggle("alarm", failed);
    at("notes").replaceChildren(...notes.map((note) => element("p", {}, note)));
    if (failed) at("assign").open = true;
  }

  /** Let the film and the cursor follow each other, as long as it is of the run that is shown. */
  linkFilm() {
    const film = this.state.filmed && !at("film").hidden ? at("video") : null;
    if (film !== this.views.film) this.views.linkFilm(film);
  }

  /** @param {{ name: string, number: number }} film */
  film({ name, number }) {
    const address = `/film?number=${number}`;
    at("video").setAttribute("src", address);
    at("video").setAttribute("aria-label", `Film of ${name}`);
    at("film-title").textContent = `Film of ${name}`;
    at("download").setAttribute("href", address);
    at("download").setAttribute("download", `${name}.mp4`);
    at("film").hidden = false;
    at("film").scrollIntoView({ block: "nearest" });
    this.views.linkFilm(null); // to the one before
    this.linkFilm();
  }

  /** @param {Refusal | null} refusal */
  refused(refusal) {
    if (refusal && refusal.task !== "show") {
      this.say(`${refusal.task}: ${refusal.text}`);
      return;
    }
    this.editor.setError(refusal);
    at("refused").hidden = !refusal;
    at("refused").textContent = refusal ? refusal.text : "";
    at("bench").classList.toggle("refused", Boolean(refusal));
    if (refusal) {
      this.say("refused; former value shown");
      this.answered();
    }
  }

  /** @param {string} text */
  remark(text) {
    this.say(text);
    this.answered();
  }

  /** @param {Proposals} proposals */
  proposals(proposals) {
    const section = at("proposals");
    section.hidden = false;
    section.replaceChildren(at("proposals-title"), ...proposalTable(proposals, (number) => this.order({ do: "try", number })));
    section.scrollIntoView({ block: "nearest" });
  }

  /** @param {string} text */
  say(text) {
    write(at("status"), text);
  }

  listen() {
    /** @type {NodeListOf<HTMLButtonElement>} */
    const buttons = document.querySelectorAll("[data-do]");
    for (const button of buttons) {
      button.addEventListener("click", () => this.order({ do: button.dataset.do }));
    }
    at("keep").addEventListener("click", () => this.order({ do: "keep", on: at("keep").getAttribute("aria-pressed") !== "true" }));
    at("jobs").addEventListener("change", () => {
      at("proposals").hidden = true;
      this.order({ do: "open", ...JSON.parse(at("jobs").value) });
    });
    at("save").addEventListener("click", () => {
      at("file").value = this.head ? this.head.name : "";
      at("saving").showModal();
    });
    at("saving").addEventListener("close", () => {
      if (at("saving").returnValue === "save") this.order({ do: "save", name: at("file").value });
    });
    at("columns-form").addEventListener("submit", (event) => {
      event.preventDefault();
      const { value } = at("period");
      this.order({ do: "columns", columns: at("columns").value, period: value === "" ? null : Number(value) });
    });
    at("film-close").addEventListener("click", () => {
      at("film").hidden = true;
      this.linkFilm();
      at("video").removeAttribute("src");
      at("video").load();
    });
    document.addEventListener("keydown", (event) => this.key(event));
    this.drops();
    this.first();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const { target } = event;
    const typing = target instanceof HTMLTextAreaElement || (target instanceof HTMLInputElement && target.type !== "range");
    if (event.key === "Escape" && this.state.busy) this.order({ do: "stop" });
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || typing) return;
    event.preventDefault();
    this.order({ do: event.shiftKey ? "redo" : "undo" });
  }

  drops() {
    document.addEventListener("dragover", (event) => {
      event.preventDefault();
      document.body.classList.add("dropping");
    });
    document.addEventListener("dragleave", (event) => {
      if (!event.relatedTarget) document.body.classList.remove("dropping");
    });
    document.addEventListener("drop", async (event) => {
      event.preventDefault();
      document.body.classList.remove("dropping");
      const dropped = event.dataTransfer;
      if (!dropped) return;
      const folder = dropped.items[0]?.webkitGetAsEntry?.();
      const file = folder?.isDirectory ? await recordOf(/** @type {FileSystemDirectoryEntry} */ (folder)) : dropped.files[0];
      if (file) await this.upload(file);
      else this.say(`${folder ? folder.name : "what was dropped"}: no file, nor a folder with ${RECORD}`);
    });
  }

  /** @param {File} file */
  async upload(file) {
    at("proposals").hidden = true;
    const answer = await fetch(`/upload?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file }).catch(/** @returns {null} */ () => null);
    if (!answer?.ok) this.say(`${file.name}: ${answer ? (await answer.text()).trim() : "the server is gone"}`);
  }

  first() {
    let seen = null;
    try {
      seen = localStorage.getItem(SEEN);
    } catch {} // a browser may keep nothing
    at("first").hidden = Boolean(seen);
    at("seen").addEventListener("click", () => {
      at("first").hidden = true;
      try {
        localStorage.setItem(SEEN, "yes");
      } catch {}
    });
  }
}

/**
 * The record in the folder of a run; null where there is none.
 *
 * @param {FileSystemDirectoryEntry} folder @returns {Promise<File | null>}
 */
function recordOf(folder) {
  return new Promise((resolve) => {
    const failed = () => resolve(null);
    folder.getFile(RECORD, {}, (entry) => /** @type {FileSystemFileEntry} */ (entry).file(resolve, failed), failed);
  });
}

new Workbench();
