// Readout, bead, path and strips of the run, or of the kept run and this one; further results are shown in place.

import { BeadMap } from "../../report/web/beadmap.js";
import { ComparedData } from "../../report/web/compared.js";
import { ComparedReadout } from "../../report/web/comparedreadout.js";
import { ComparedStrips } from "../../report/web/comparison.js";
import { Cursor } from "../../report/web/cursor.js";
import { nearest, RunData } from "../../report/web/data.js";
import { element, toggle } from "../../report/web/dom.js";
import { regionOf } from "../../report/web/map.js";
import { Overlay } from "../../report/web/overlay.js";
import { Plan } from "../../report/web/plan.js";
import { Readout } from "../../report/web/readout.js";
import { Space } from "../../report/web/space.js";
import { Strips } from "../../report/web/strips.js";

/** @type {Record<string, string>} */
const LABELS = { bead: "Bead", plan: "Path error", both: "Both", space: "3-D" };
/** @type {Record<string, string[]>} */
const SHOWN = { both: ["bead", "plan"] }; // by a choice, where it is not the view of its name

/** @type {Promise<typeof import("../../report/web/view3d.js").View>} */
let spaceView;

/** The class of the 3-D view, whose script is loaded once. */
function loadSpace() {
  spaceView ??= new Promise((resolve, reject) => {
    const script = element("script", { src: "/viewer3d.js" });
    script.addEventListener("load", () => resolve(window.gantrysimSpace.View));
    script.addEventListener("error", () => reject(new Error("the script of the 3-D view was not sent")));
    document.head.append(script);
  });
  return spaceView;
}

export class Views {
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
    this.choice = "bead";
    this.shape = "";
    /** @type {Record<string, RunView>} */
    this.views = {};
    /** @type {RunData | ComparedData} */
    this.data = null;
  }

  /**
   * Show the content of a result of a job; without rows nothing is shown.
   *
   * @param {RunContent | ComparedContent} content @param {string} name of the job
   */
  show(content, name) {
    if (!content.rows) {
      this.shape = "";
      this.data = null;
      for (const place of Object.values(this.places)) place.replaceChildren();
      return;
    }
    const shape = JSON.stringify([name, Boolean(this.placing.place()), ...shapeOf(content)]);
    if (shape === this.shape) this._update(content);
    else this._build(content);
    this.shape = shape;
  }

  /** @param {RunContent | ComparedContent} content */
  _build(content) {
    this.strips?.remove();
    for (const view of this._all()) view.remove?.();
    if ("runs" in content) this._buildCompared(new ComparedData(content));
    else this._buildRun(new RunData(content));
    this.moving = false;
    for (const { map } of this._all()) if (map) this._movable(map);
    this.places.readout.replaceChildren(this.readout.element);
    this.places.views.replaceChildren(this._choices(), ...this._all().map((view) => view.element));
    this.places.strips.replaceChildren(this.strips.element);
    this._choose(this.choice);
    this.cursor.set(this.cursor.row, "start");
  }

  /** @param {RunData | ComparedData} data */
  _hold(data) {
    this.data = data;
    this.cursor = new Cursor(data.rows, data.worst);
    this.region = this._region();
  }

  /** @param {ComparedData} data */
  _buildCompared(data) {
    this._hold(data);
    const strips = new ComparedStrips(data, this.cursor);
    const overlay = new Overlay(data, this.cursor, this.region);
    this.strips = strips;
    this.views = { overlay };
    this.readout = new ComparedReadout(data, this.cursor, (number, shown) => {
      strips.setRun(number, shown);
      overlay.setRun(number, shown);
    });
  }

  /** @param {RunData} data */
  _buildRun(data) {
    this._hold(data);
    const { cursor, region } = this;
    const strips = new Strips(data, cursor);
    this.strips = strips;
    this.readout = new Readout(data, cursor, (name, shown) => strips.setShown(name, shown));
    this.views = {};
    if (data.width || data.dots.length) this.views.bead = new BeadMap(data, cursor, region);
    this.views.plan = new Plan(data, cursor, region);
    if (data.space) this.views.space = new Space(data, cursor, loadSpace);
    cursor.onMove((row) => this.lineAt(data.column.line[row]));
  }

  /** @param {RunContent | ComparedContent} content */
  _update(content) {
    const { data, cursor } = this;
    const places = this._along();
    const wasWorst = cursor.row === data.worst && !cursor.pinned;
    const place = places[Math.min(cursor.row, places.length - 1)];
    if ("runs" in content) /** @type {ComparedData} */ (data).load(content);
    else /** @type {RunData} */ (data).load(content);
    if (!this.held) this.region.box = this._region().box; // drawn below, with the scales of the new data
    cursor.resize(data.rows, wasWorst ? data.worst : nearest(this._along(), place));
    for (const view of [...this._all(), this.strips]) view.update();
  }

  _all() {
    return Object.values(this.views);
  }

  /** What the cursor holds on to while runs change: the time, or the common place. */
  _along() {
    return "time" in this.data ? this.data.time : this.data.along;
  }

  _region() {
    const { data } = this;
    if ("runs" in data) {
      /** @param {string} name */
      const columns = (name) => data.runs.map((run, k) => data.column[`${name}.${k}`]);
      return regionOf(columns("x"), columns("y"), data.width);
    }
    const widest = data.dots.reduce((most, dot) => Math.max(most, 2 * dot.radius), data.width || 0);
    return regionOf([data.column.x, data.requested.x], [data.column.y, data.requested.y], widest);
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
    /** @param {string} choice */
    const isThere = (choice) => (SHOWN[choice] || [choice]).every((name) => name in this.views);
    const choices = Object.keys(LABELS).filter(isThere);
    if (choices.length && !isThere(this.choice)) this.choice = choices[0];
    this.buttons = choices.map((choice) => {
      const button = element("button", { type: "button", "data-view": choice }, LABELS[choice]);
      button.addEventListener("click", () => this._choose(choice));
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
    for (const [name, view] of Object.entries(this.views)) view.element.hidden = !shown.includes(name);
  }

  /** Highlight the path of a line of the program, 0 for none. @param {number} line */
  chooseLine(line) {
    if (!this.cursor || !this.data || "runs" in this.data || this.cursor.line === line) return;
    this.cursor.choose(line || this.cursor.line);
    const row = line ? this.data.column.line.indexOf(line) : -1;
    if (row >= 0) this.cursor.set(row, "line");
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
