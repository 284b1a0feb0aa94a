// One line below the first screen's picture: where the cursor is, and what it shows there.

import { element } from "./dom.js";

export class Moment {
  /** @param {RunData} data @param {Cursor} cursor */
  constructor(data, cursor) {
    this.data = data;
    this.element = element("output", { class: "now", "aria-live": "off" });
    cursor.onMove((row) => this._show(row));
    this._show(cursor.row);
  }

  /** @param {number} row */
  _show(row) {
    const { data } = this;
    const line = data.column.line[row];
    const parts = [`${row === data.worst ? "worst: " : ""}t = ${data.time[row].toFixed(3)} s`];
    if (line) parts.push(`line ${line}`);
    if (!isNaN(data.size[row])) parts.push(`path error ${data.text("contour", row)}`);
    if (data.width && data.column.dispense[row]) parts.push(`bead width ${data.text("width", row)}`);
    // lines end between parts only
    this.element.textContent = parts.map((part) => part.replaceAll(" ", "\u00a0")).join(" · ");
  }
}
