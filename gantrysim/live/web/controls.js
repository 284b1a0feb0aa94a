// Sliders, numbers and choices for the values of the job.

import { element, toggle } from "../../report/web/dom.js";

const STEPS = 1000; // of a slider
const PLACE = ["program.placement.x", "program.placement.y"];
/** @type {Record<string, string>} */
const HEADS = { machine: "Machine", program: "Program", servo: "Servo", glue: "Glue", placement: "Placement" };

export class Controls {
  /**
   * @param {HTMLElement} place
   * @param {(values: Record<string, unknown>, dragging: boolean) => void} changed called with values by key, and whether a
   *   slider is being dragged
   */
  constructor(place, changed) {
    this.box = place;
    this.changed = changed;
    this.rows = new Map();
    this.controls = new Map();
    this.shape = "";
  }

  /** Show the values of the controls; those that are being used keep theirs. @param {ControlContent[]} controls */
  show(controls) {
    const shape = JSON.stringify(controls.map(({ key, low, high, options, initial }) => [key, low, high, options, initial]));
    if (shape !== this.shape) this._build(controls);
    this.shape = shape;
    for (const control of controls) this.rows.get(control.key).set(control.value);
    this.controls = new Map(controls.map((control) => [control.key, control]));
  }

  /** The placement of the part, null where the job has none. */
  place() {
    const [x, y] = PLACE.map((key) => this.controls.get(key)?.value);
    return x === undefined || y === undefined ? null : { x, y };
  }

  /** Move the part, within its bounds. @param {number} x @param {number} y @param {boolean} dragging */
  move(x, y, dragging) {
    const values = [x, y].map((value, k) => {
      const { low, high } = this.controls.get(PLACE[k]);
      return Number(clipped(value, low, high).toFixed(2));
    });
    this.changed(Object.fromEntries(PLACE.map((key, k) => [key, values[k]])), dragging);
  }

  /** @param {ControlContent[]} controls */
  _build(controls) {
    this.rows.clear();
    const groups = new Map();
    for (const control of controls) {
      if (!groups.has(control.group)) {
        groups.set(control.group, element("fieldset", {}, element("legend", {}, HEADS[control.group] || control.group)));
      }
      const row = control.additions.length ? this._laws(control) : control.options.length ? this._choice(control) : this._slider(control);
      this.rows.set(control.key, row);
      groups.get(control.group).append(row.element);
    }
    this.box.replaceChildren(...groups.values());
  }

  /** @param {ControlContent} control */
  _reset(control) {
    const button = element("button", { type: "button", class: "reset", "aria-label": `reset ${control.label}`, title: "reset" }, "↺");
    button.addEventListener("click", () => this.changed({ [control.key]: null }, false));
    return button;
  }

  /** @param {ControlContent} control */
  _slider(control) {
    const { key, label, unit, low, high, is_ratio: isRatio, meaning } = control;
    const initial = Number(control.initial);
    /** @param {number} value */
    const share = (value) => (isRatio ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low));
    /** @param {number} part */
    const valueAt = (part) => (isRatio ? low * (high / low) ** part : low + part * (high - low));
    const slider = element("input", { type: "range", min: 0, max: STEPS, step: 1, "aria-label": label, "data-key": key });
    const number = element("input", { type: "number", min: low, max: high, step: "any", "aria-label": `${label}, ${unit || "number"}`, "data-number": key });
    const reset = this._reset(control);
    const row = element("div", { class: "control", title: meaning }, element("span", { class: "label" }, label), number, element("span", { class: "unit" }, unit), reset, slider);
    let held = false; // while it is dragged or typed in
    /** @param {number} value */
    const paint = (value) => {
      const text = `${short(value)} ${unit}`.trim();
      if (slider.getAttribute("aria-valuetext") !== text) slider.setAttribute("aria-valuetext", text);
      reset.hidden = Math.abs(value - initial) <= 1e-9 * Math.abs(initial);
    };
    slider.addEventListener("input", () => {
      held = true;
      const value = Number(clipped(valueAt(Number(slider.value) / STEPS), low, high).toPrecision(4));
      number.value = short(clipped(value, low, high));
      paint(value);
      this.changed({ [key]: clipped(value, low, high) }, true);
    });
    slider.addEventListener("change", () => {
      held = false;
      this.changed({ [key]: Number(number.value) }, false);
    });
    number.addEventListener("change", () => {
      if (number.value !== "") this.changed({ [key]: clipped(Number(number.value), low, high) }, false);
    });
    /** @param {number} value */
    const set = (value) => {
      if (held) return;
      // what stays is not written: the browser would paint it again
      const text = short(value);
      const isTyped = document.activeElement === number && number.value !== "";
      if (!isTyped && number.value !== text) number.value = text;
      const place = String(Math.round(STEPS * share(value)));
      if (slider.value !== place) slider.value = place;
      paint(value);
    };
    return { element: row, set };
  }

  /** @param {ControlContent} control */
  _choice(control) {
    const { key, label, options, initial } = control;
    const select = element("select", { "aria-label": label, "data-key": key }, ...options.map((name) => element("option", { value: name }, name.replace(/.*[\\/]/, ""))));
    const reset = this._reset(control);
    select.addEventListener("change", () => this.changed({ [key]: select.value }, false));
    const row = element("div", { class: "control choice-row" }, element("span", { class: "label" }, label), select, reset);
    return {
      element: row,
      /** @param {string} value */
      set: (value) => {
        select.value = value;
        reset.hidden = value === initial;
      },
    };
  }

  /** @param {ControlContent} control */
  _laws(control) {
    const { key, label, options, additions, initial } = control;
    let value = /** @type {string[]} */ (initial);
    const select = element("select", { "aria-label": label, "data-key": key }, ...options.map((name) => element("option", { value: name }, name)));
    select.addEventListener("change", () => this.changed({ [key]: [select.value, ...value.slice(1)] }, false));
    const buttons = additions.map((name) =>
      toggle(name, false, (on) => {
        const others = value.filter((law) => law !== name);
        this.changed({ [key]: on ? [...others, name] : others }, false);
      }, { "data-law": name }),
    );
    const reset = this._reset(control);
    const row = element("div", { class: "control choice-row" }, element("span", { class: "label" }, label), select, reset, element("div", { class: "laws" }, ...buttons));
    return {
      element: row,
      /** @param {string[]} laws */
      set: (laws) => {
        value = laws;
        select.value = laws[0];
        for (const button of buttons) button.setAttribute("aria-pressed", String(laws.includes(button.dataset.law ?? "")));
        reset.hidden = JSON.stringify(laws) === JSON.stringify(initial);
      },
    };
  }
}

/** @param {number} value @param {number} low @param {number} high */
function clipped(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

/** @param {number} value */
function short(value) {
  return String(Number(value.toPrecision(4)));
}
