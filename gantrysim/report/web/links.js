// Times, places and program lines in the page's text as links that move the cursor.

import { element, within } from "./dom.js";
import { number } from "./data.js";

const NUMBER = "[−-]?[\\d,]*\\.?\\d+";
const PATTERN = new RegExp(
  // a space may be one at which no line ends
  `t = (${NUMBER}) s|x = (${NUMBER}), y = (${NUMBER})(?:, z = (${NUMBER}))? mm|\\bline (\\d+)\\b`.replaceAll(" ", "\\s"),
  "g",
);
const SKIPPED = "script, style, pre, svg, h1, h2, nav, a, button, .viewer, .stage";
const TIME_HEAD = /^t \[s\]$/;

/** @param {string} text */
const valueOf = (text) => parseFloat(text.replace("−", "-").replace(/,/g, ""));

export class Links {
  /**
   * @param show called after the cursor has moved @param {RunData} data @param {Cursor} cursor
   * @param {() => void} show
   */
  constructor(data, cursor, show) {
    this.data = data;
    this.cursor = cursor;
    this.show = show;
    const main = within(document, "main");
    const walker = document.createTreeWalker(main, NodeFilter.SHOW_TEXT);
    const texts = [];
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
      if (!node.parentElement?.closest(SKIPPED)) texts.push(node);
    }
    for (const node of texts) this._linked(/** @type {Text} */ (node));
    for (const table of main.querySelectorAll("table")) this._times(table);
  }

  /** @param {Text} node */
  _linked(node) {
    const parts = [];
    let done = 0;
    for (const match of node.data.matchAll(PATTERN)) {
      const row = this._row(match);
      if (row === null) continue;
      parts.push(node.data.slice(done, match.index), this._link(match[0], row));
      done = match.index + match[0].length;
    }
    if (parts.length) node.replaceWith(...parts, node.data.slice(done));
  }

  /** The cells of a table's column of times. @param {HTMLTableElement} table */
  _times(table) {
    const heads = [...table.querySelectorAll("thead th")];
    const column = heads.findIndex((head) => TIME_HEAD.test(head.textContent.trim()));
    if (column < 0) return;
    for (const row of table.tBodies[0].rows) {
      const cell = row.cells[column];
      const time = valueOf(cell.textContent);
      if (!isNaN(time)) cell.replaceChildren(this._link(cell.textContent, this.data.rowAt(time)));
    }
  }

  /**
   * The row of the run that a time, a place or a line names; null for none.
   *
   * @param {RegExpMatchArray} match
   */
  _row([, time, x, y, z, line]) {
    const { data } = this;
    if (time !== undefined) return data.rowAt(valueOf(time));
    if (line !== undefined) {
      const row = data.column.line.indexOf(Number(line));
      return row < 0 ? null : row;
    }
    const place = [x, y, z].map((text) => (text === undefined ? NaN : valueOf(text)));
    const columns = ["x", "y", "z"].map((name) => data.column[name]);
    let nearest = null;
    let least = Infinity;
    for (let row = 0; row < data.rows; row++) {
      let square = 0;
      place.forEach((value, axis) => {
        if (columns[axis] && !isNaN(value)) square += (columns[axis][row] - value) ** 2;
      });
      if (square < least) [least, nearest] = [square, row];
    }
    return nearest;
  }

  /** @param {string} text @param {number} row */
  _link(text, row) {
    const title = `move the cursor to t = ${number(this.data.time[row], 3)} s`;
    const link = element("button", { type: "button", class: "moment", title }, text);
    link.addEventListener("click", () => {
      this.cursor.pinned = true;
      this.cursor.set(row, "link");
      this.show();
    });
    return link;
  }
}
