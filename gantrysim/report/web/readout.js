// The values at the cursor; the links' cells are the legend, which switches them on and off.

import { element, sample } from "./dom.js";
import { colourOf, onTheme, theme } from "./theme.js";

const HIDDEN = new Set(["dx", "dy", "distance"]);

export class Readout {
  /**
   * @param {RunData} data @param {Cursor} cursor
   * @param {(name: string, shown: boolean) => void} setShown called with the name of a link and whether it is shown
   */
  constructor(data, cursor, setShown) {
    this.data = data;
    this.setShown = setShown;
    /** @type {Record<string, HTMLElement>} */
    this.cells = {};
    this.element = element("div", { class: "readout", role: "group", "aria-label": "Values at the cursor" });
    this._add("time", "t");
    for (const series of data.series) if (!HIDDEN.has(series.name)) this._add(series.name, series.label, series.meaning, series);
    this._add("dispense", "dispenser", "");
    if (data.program) this._add("line", "line", "of the program");
    this.pin = element("span", { class: "pin" });
    this.element.append(this.pin);
    this.cursor = cursor;
    cursor.onMove((row) => this._show(row));
    this._show(cursor.row);
  }

  /** @param {string} name @param {string} label @param {string} [meaning] @param {SeriesContent} [series] */
  _add(name, label, meaning, series) {
    const value = element("output", { "data-name": name, "aria-live": "off" });
    const link = series && series.group === "error";
    const cell = link ? this._button(series) : element("div", {}, element("span", {}, label));
    if (meaning) cell.title = meaning;
    cell.classList.add("cell");
    cell.append(value);
    this.cells[name] = value;
    this.element.append(cell);
  }

  /** @param {SeriesContent} series */
  _button(series) {
    const button = element("button", { type: "button", "aria-pressed": "true", "data-link": series.name });
    const paint = () => {
      button.querySelector("svg")?.remove();
      button.prepend(sample(colourOf(series, theme()), series.dash));
    };
    button.append(element("span", {}, series.label));
    paint();
    onTheme(paint);
    button.addEventListener("click", () => {
      const shown = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", String(shown));
      this.setShown(series.name, shown);
    });
    return button;
  }

  /** @param {number} row */
  _show(row) {
    const { data, cells } = this;
    /** @type {Record<string, string>} */
    const texts = { time: `${data.time[row].toFixed(3)} s`, dispense: data.column.dispense[row] ? "on" : "off" };
    const line = data.column.line[row];
    for (const [name, cell] of Object.entries(cells)) {
      let text = texts[name];
      if (name === "line") text = line ? String(line) : "–";
      else if (text === undefined) text = data.text(name, row);
      cell.textContent = text;
    }
    this.pin.textContent = this.cursor.pinned ? "pinned, Esc releases" : "";
  }
}
