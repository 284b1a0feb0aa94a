// One line below the first screen's picture: where the cursor is, and what it shows there.

import { digits } from "./data.js";
import { element } from "./dom.js";

export class Moment {
  /** @param {RunData} data @param {Cursor} cursor */
  constructor(data, cursor) {
    this.data = data;
    this.output = element("output", { class: "now", "aria-live": "off" });
    this.element = element("div", {}, this.output);
    const notes = data.ploughed.length ? ["Line with an edge: the needle in its own bead."] : [];
    if (data.unjudged_ends) notes.push(endsNote(data.unjudged_ends));
    if (notes.length) this.element.append(element("small", {}, notes.join(" ")));
    cursor.onMove((row) => this._show(row));
    this._show(cursor.row);
  }

  /** @param {number} row */
  _show(row) {
    const { data } = this;
    const line = data.column.line[row];
    const time = `t = ${data.time[row].toFixed(3)} s`;
    const parts = row !== data.worst ? [time] : [`worst: ${data.worstValue || time}`];
    if (row === data.worst && data.worstValue) parts.push(time);
    if (line) parts.push(`line ${line}`);
    if (!isNaN(data.size[row]) && !(row === data.worst && data.shown === "path")) parts.push(`path error ${data.sizeText(row)}`);
    if (data.width && data.column.dispense[row]) parts.push(`bead width ${data.text("width", row)}`);
    // lines end between parts only
    this.output.textContent = parts.map((part) => part.replaceAll(" ", "\u00a0")).join(" · ");
  }
}

/** Where the width of the bead is not judged. @param {[number, number]} lengths of bead after a start, and before a stop */
function endsNote([start, stop]) {
  const lengths = start === stop ? `${digits(stop)}\u00a0mm of a start or stop` : `${digits(start)}\u00a0mm of a start and ${digits(stop)}\u00a0mm of a stop`;
  return `Without colour where the width is not judged: within ${lengths}, where the length of missing or excess glue is judged instead.`;
}
