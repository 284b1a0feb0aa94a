// Readout, bead, path and strips of the run, or of the kept run and this one; further results are shown in place.

import { BeadMap } from "../../report/web/beadmap.js";
import { ComparedData } from "../../report/web/compared.js";
import { ComparedReadout } from "../../report/web/comparedreadout.js";
import { ComparedStrips } from "../../report/web/comparison.js";
import { Cursor } from "../../report/web/cursor.js";
import { nearest, RunData } from "../../report/web/data.js";
import { element, toggle } from "../../report/web/dom.js";
import { FilmLink } from "../../report/web/film.js";
import { regionOf } from "../../report/web/map.js";
import { Overlay } from "../../report/web/overlay.js";
import { Plan } from "../../report/web/plan.js";
import { Readout } from "../../report/web/readout.js";
import { Space } from "../../report/web/space.js";
import { Strips } from "../../report/web/strips.js";

/** @type {Record<string, string>} */
const LABELS = { bead: "Bead", plan: "Path error", both: "Both", overlay: "Plan", space: "3-D" };
/** @type {Record<string, string[]>} */
const SHOWN = { both: ["bead", "plan"] }; // by a choice, where it is not the view of its name

const QUICK = "loop"; // engine of the first answer to a change

/** @type {Promise<Window["gantrysimSpace"]> | undefined} */
let spaceViews;

/** The classes of the 3-D views, whose script is loaded once. */
function loadSpace() {
  spaceViews ??= new Promise((resolve, reject) => {
    const script = element("script", { src: "/viewer3d.js" });
    script.addEventListener("load", () => resolve(window.gantrysimSpace));
    script.addEventListener("error", () => reject(new Error("the script of the 3-D view was not sent")));
    document.head.append(script);
  });
  return spaceViews;
}

/**
 * What shows a run, or runs over one another.
 *
 * @template {RunData | ComparedData} Data
 * @typedef {object} Shown
 * @property {Data} data
 * @property {Cursor} cursor
 * @property {Region} region what the maps show
 * @property {Strips<Data>} strips
 * @property {{ element: HTMLElement }} readout
 * @property {Record<string, RunView>} views by their choices
 */

/** @param {RunData} data @returns {Shown<RunData>} */
function shownRun(data) {
  const cursor = new Cursor(data.rows, data.worst);
  const region = regionOfRun(data);
  const strips = new Strips(data, cursor);
  const readout = new Readout(data, cursor, (name, shown) => strips.setShown(name, shown));
  /** @type {Record<string, RunView>} */
  const views = {};
  if (data.width || data.dots.length) views.bead = new BeadMap(data, cursor, region);
  views.plan = new Plan(data, cursor, region);
  if (data.space) views.space = new Space(async () => new (await loadSpace()).View(data, cursor));
  return { data, cursor, region, strips, readout, views };
}

/** @param {ComparedData} data @returns {Shown<ComparedData>} */
function shownRuns(data) {
  const cursor = new Cursor(data.rows, data.worst);
  const region = regionOfRuns(data);
  const strips = new ComparedStrips(data, cursor);
  const overlay = new Overlay(data, cursor, region);
  const space = new Space(async () => new (await loadSpace()).ComparedView(data, cursor));
  const readout = new ComparedReadout(data, cursor, (number, shown) => {
    strips.setRun(number, shown);
    overlay.setRun(number, shown);
    space.update();
  });
  /** @type {Record<string, RunView>} */
  const views = { overlay };
  if (data.gaps) views.space = space;
  return { data, cursor, region, strips, readout, views };
}

/** @param {RunData} data */
function regionOfRun(data) {
  const widest = data.dots.reduce((most, dot) => Math.max(most, 2 * dot.radius), data.width || 0);
  return regionOf([data.column.x, data.requested.x], [data.column.y, data.requested.y], widest);
}

/** @param {ComparedData} data */
function regionOfRuns(data) {
  /** @param {string} name */
  const columns = (name) => data.runs.map((run, k) => data.column[`${name}.${k}`]);
  return regionOf(columns("x"), columns("y"), data.width);
}

/** What the cursor holds on to while runs change: the time, or the common place. @param {RunData | ComparedData} data */
const placesOf = (data) => ("time" in data ? data.time : data.along);

export class Views {
  /** What is shown; null before any result. @type {Shown<RunData> | Shown<ComparedData> | null} */
  shown = null;
  /** @type {HTMLButtonElement[]} */
  buttons = [];
  /** @type {FilmLink | null} */
  link = null;

  /**
   * @param {Record<string, HTMLElement>} places elements for readout, views and strips
   * @param {(line: number) => void} lineAt called with the program's line at the cursor
   * @param {Controls} placing has the placement of the part, null for none, and moves it
   */
  constructor(places, lineAt, placing) {
    this.places = places;
    this.lineAt = lineAt;
    this.placing = placing;
    this.moving = false; // whether a drag moves the part
    this.held = false; // while it does
    this.wish = "bead"; // the view that was chosen; another is shown where the present runs have none
    this.choice = "bead";
    this.outdated = new Set(); // views that were hidden when the data changed
    this.shape = "";
    /** The film of the run that is shown. @type {HTMLVideoElement | null} */
    this.film = null;
  }

  /**
   * Show the content of a result; without rows nothing is shown.
   *
   * @param {RunContent | ComparedContent} content @param {Head} head
   */
  show(content, head) {
    if (!content.rows) {
      this._clear();
      return;
    }
    const shape = JSON.stringify([head.name, Boolean(this.placing.place()), ...shapeOf(content)]);
    if (shape !== this.shape || !this._update(content, head.engine === QUICK)) this._build(content);
    this.shape = shape;
  }

  _clear() {
    this.link?.remove();
    this.link = null;
    this.shown?.strips.remove();
    for (const view of this._all()) view.remove?.();
    this.outdated.clear();
    this.shown = null;
    this.shape = "";
    for (const place of Object.values(this.places)) place.replaceChildren();
  }

  /** @param {RunContent | ComparedContent} content */
  _build(content) {
    this._clear();
    const shown = "runs" in content ? shownRuns(new ComparedData(content)) : shownRun(new RunData(content));
    this.shown = shown;
    const { data, cursor } = shown;
    if (data instanceof RunData) cursor.onMove((row) => this.lineAt(data.column.line[row]));
    this.moving = false;
    for (const { map } of this._all()) if (map) this._movable(map);
    this.places.readout.replaceChildren(shown.readout.element);
    this.places.views.replaceChildren(this._choices(), ...this._all().map((view) => view.element));
    this.places.strips.replaceChildren(shown.strips.element);
    this._choose(this.choice);
    cursor.set(cursor.row, "start");
    this.linkFilm(this.film);
  }

  /**
   * Show other data in the same views; returns whether these can.
   *
   * @param {RunContent | ComparedContent} content @param {boolean} isQuick whether verdict and maps come first
   */
  _update(content, isQuick) {
    if (!this.shown) return false;
    const { shown } = this;
    const { data, cursor, region, strips } = shown;
    const places = placesOf(data);
    const wasWorst = cursor.row === data.worst && !cursor.pinned;
    const place = places[Math.min(cursor.row, places.length - 1)];
    if (data instanceof RunData && !("runs" in content)) data.load(content);
    else if (data instanceof ComparedData && "runs" in content) data.load(content);
    else return false;
    // drawn below, with the scales of the new data
    if (!this.held) region.box = (data instanceof RunData ? regionOfRun(data) : regionOfRuns(data)).box;
    cursor.resize(data.rows, wasWorst ? data.worst : nearest(placesOf(data), place));
    for (const view of this._all()) {
      if (view.element.hidden) this.outdated.add(view);
      else view.update();
    }
    if (!isQuick) strips.update();
    // in the frame after that of the maps, unless other views have taken the place of these
    else requestAnimationFrame(() => setTimeout(() => this.shown === shown && strips.update()));
    return true;
  }

  _all() {
    return this.shown ? Object.values(this.shown.views) : [];
  }

  /**
   * Let a film and the cursor follow each other; null where there is none of the run that is shown.
   *
   * @param {HTMLVideoElement | null} film
   */
  linkFilm(film) {
    this.film = film;
    this.link?.remove();
    this.link = null;
    if (film && this.shown && this.shown.data instanceof RunData) this.link = new FilmLink(film, this.shown.data, this.shown.cursor);
  }

  /** Let a drag on a map move the part, where that is chosen; the map stands still meanwhile. @param {PlanMap} map */
  _movable(map) {
    const { surface } = map;
    /** @type {{ x: number, y: number, scale: number, place: Point } | null} */
    let from = null;
    /** @param {PointerEvent} event @param {boolean} dragging */
    const move = (event, dragging) => {
      if (!from) return;
      event.stopImmediatePropagation();
      const x = from.place.x + (event.clientX - from.x) / from.scale;
      const y = from.place.y - (event.clientY - from.y) / from.scale;
      if (!dragging) this.held = false;
      this.placing.move(x, y, dragging);
      if (!dragging) from = null;
    };
    const options = { capture: true }; // before the map's own gestures
    surface.addEventListener(
      "pointerdown",
      (event) => {
        const place = this.placing.place();
        if (!this.moving || event.button || !place) return;
        event.stopImmediatePropagation();
        event.preventDefault();
        surface.setPointerCapture(event.pointerId);
        from = { x: event.clientX, y: event.clientY, scale: map.scale, place };
        this.held = true;
      },
      options,
    );
    surface.addEventListener("pointermove", (event) => move(event, true), options);
    for (const name of /** @type {const} */ (["pointerup", "pointercancel"])) surface.addEventListener(name, (event) => move(event, false), options);
  }

  _mover() {
    if (!this.placing.place()) return [];
    /** @param {boolean} on */
    const changed = (on) => {
      this.moving = on;
      for (const { map } of this._all()) map?.surface.classList.toggle("moving", on);
    };
    return [toggle("Move part", false, changed, { title: "drag the part to another place; the sliders x and y do the same" })];
  }

  /** The buttons that choose what is shown. */
  _choices() {
    const views = this.shown?.views ?? {};
    /** @param {string} choice */
    const isThere = (choice) => (SHOWN[choice] || [choice]).every((name) => name in views);
    const choices = Object.keys(LABELS).filter(isThere);
    this.choice = isThere(this.wish) ? this.wish : choices[0];
    this.buttons = choices.map((choice) => {
      const button = element("button", { type: "button", "data-view": choice }, LABELS[choice]);
      button.addEventListener("click", () => {
        this.wish = choice;
        this._choose(choice);
      });
      return button;
    });
    return element("div", { class: "choices", role: "group", "aria-label": "View" }, ...this.buttons, ...this._mover());
  }

  /** @param {string} choice */
  _choose(choice) {
    this.choice = choice;
    if (!this.buttons.length) return;
    for (const button of this.buttons) button.setAttribute("aria-pressed", String(button.dataset.view === choice));
    const shown = SHOWN[choice] || [choice];
    for (const [name, view] of Object.entries(this.shown?.views ?? {})) {
      view.element.hidden = !shown.includes(name);
      if (!view.element.hidden && this.outdated.delete(view)) view.update();
    }
  }

  /** Highlight the path of a line of the program, 0 for none. @param {number} line */
  chooseLine(line) {
    if (!this.shown || !(this.shown.data instanceof RunData) || this.shown.cursor.line === line) return;
    const { data, cursor } = this.shown;
    cursor.choose(line || cursor.line);
    const row = line ? data.column.line.indexOf(line) : -1;
    if (row >= 0) cursor.set(row, "line");
  }
}

/**
 * What decides which views there are: where it stays, results are shown in place.
 *
 * @param {RunContent | ComparedContent} content
 */
function shapeOf(content) {
  const namesOf = (/** @type {{ name: string }[]} */ named) => named.map(({ name }) => name);
  if ("runs" in content) return [namesOf(content.quantities), namesOf(content.runs), Boolean(content.width), content.by_path];
  return [namesOf(content.series), Boolean(content.width), Boolean(content.dots.length)];
}
