// The values of all runs at the cursor, a row for each run; its head is the legend and switches the run on and off.

import { element, sample } from "./dom.js";
import { colourOf, onTheme, theme } from "./theme.js";

export class ComparedReadout {
  /**
   * @param {ComparedData} data @param {Cursor} cursor
   * @param {(run: number, shown: boolean) => void} setRun called with the number of a run and whether it is shown
   */
  constructor(data, cursor, setRun) {
    this.data = data;
    this.setRun = setRun;
    /** @type {[HTMLElement, (row: number) => string][]} */
    this.cells = [];
    this.place = element("th", { scope: "col", class: "place" });
    const timed = data.by_path ? [{ name: "time", label: "t", unit: "s", decimals: 3, group: "" }] : [];
    /** @type {SeriesContent[]} */
    const quantities = [...timed, ...data.quantities];
    const heads = quantities.map(({ label, meaning }) => element("th", { scope: "col", title: meaning || "" }, label));
    const rows = data.runs.map((run, k) => this._run(run, k, quantities));
    if (data.runs.length === 2 && data.by_path) rows.push(this._difference(quantities));
    const head = element("thead", {}, element("tr", {}, this.place, ...heads));
    const table = element("table", {}, head, element("tbody", {}, ...rows));
    this.element = element("div", { class: "readout compared", role: "group", "aria-label": "Values at the cursor" }, table);
    this.cursor = cursor;
    cursor.onMove((row) => this._show(row));
    this._show(cursor.row);
  }

  /** @param {RunLooks} run @param {number} number @param {SeriesContent[]} quantities */
  _run(run, number, quantities) {
    const button = element("button", { type: "button", "aria-pressed": "true", "data-run": number });
    const paint = () => {
      button.querySelector("svg")?.remove();
      button.prepend(sample(colourOf({ colour: run.colour }, theme()), run.dash));
    };
    button.append(element("span", {}, run.name));
    paint();
    onTheme(paint);
    button.addEventListener("click", () => {
      const shown = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", String(shown));
      this.setRun(number, shown);
    });
    /** @param {SeriesContent} quantity @returns {(row: number) => string} */
    const text = ({ name, decimals, unit }) => {
      if (name !== "time") return (row) => this.data.text(`${name}.${number}`, row);
      return (row) => {
        const time = this.data.column[`time.${number}`][row];
        return isNaN(time) ? "–" : `${time.toFixed(decimals)} ${unit}`;
      };
    };
    return this._row(button, quantities, `${number}`, text);
  }

  /** @param {SeriesContent[]} quantities */
  _difference(quantities) {
    const [first, second] = this.data.runs;
    const head = element("span", { title: `${second.name} less ${first.name}` }, "difference");
    return this._row(head, quantities, "difference", (quantity) => (row) => this.data.differenceText(quantity, row));
  }

  /**
   * @param {string} key
   * @param {HTMLElement} head @param {SeriesContent[]} quantities @param {(quantity: SeriesContent) => (row: number) => string} textOf
   */
  _row(head, quantities, key, textOf) {
    const cells = quantities.map((quantity) => {
      const cell = element("output", { "data-name": `${quantity.name}.${key}`, "aria-live": "off" });
      this.cells.push([cell, textOf(quantity)]);
      return element("td", {}, cell);
    });
    return element("tr", {}, element("th", { scope: "row" }, head), ...cells);
  }

  /** @param {number} row */
  _show(row) {
    this.place.textContent = this.data.placeText(row);
    for (const [cell, text] of this.cells) cell.textContent = text(row);
    this.place.classList.toggle("pinned", this.cursor.pinned);
  }
}
