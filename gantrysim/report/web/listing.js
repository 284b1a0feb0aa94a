// The program, line by line: a click shows a line's stretches of the path, and the line at the cursor is marked.

import { element } from "./dom.js";

export class Listing {
  /** @param {RunData} data @param {Cursor} cursor */
  constructor(data, cursor) {
    this.data = data;
    this.cursor = cursor;
    this.rows = new Map();
    data.column.line.forEach((line, row) => {
      if (line && !this.rows.has(line)) this.rows.set(line, row);
    });
    this.buttons = new Map();
    const list = element("ol", { class: "lines" });
    for (const [number, text] of Object.entries(data.program ?? {})) list.append(this._line(Number(number), text));
    list.addEventListener("keydown", (event) => this._key(event));
    this.list = list;
    const caption = element("figcaption", {}, element("b", {}, "Program"), " click a line to see its path");
    this.element = element("figure", { class: "view listing" }, caption, list);
    this._focusable(this.buttons.values().next().value);
    cursor.onMove((row) => this._mark(row));
    cursor.onChoice((line) => this._chosen(line));
  }

  /** @param {number} number @param {string} text */
  _line(number, text) {
    const item = element("li", { value: number });
    if (!this.rows.has(number)) {
      item.append(element("code", {}, text || " "));
      return item;
    }
    const button = element("button", { type: "button", "data-line": number, "aria-pressed": "false", tabindex: "-1" });
    button.append(element("code", {}, text));
    button.addEventListener("click", () => {
      this._focusable(button);
      this.cursor.choose(number);
      if (this.cursor.line) {
        this.cursor.pinned = true;
        this.cursor.set(this.rows.get(number), this);
      }
    });
    this.buttons.set(number, button);
    item.append(button);
    return item;
  }

  /** Let only one line be reached by the tab key, the others by arrows. @param {HTMLButtonElement} button */
  _focusable(button) {
    if (this.reached) this.reached.tabIndex = -1;
    this.reached = button;
    button.tabIndex = 0;
  }

  /** @param {KeyboardEvent} event */
  _key(event) {
    const step = { ArrowUp: -1, ArrowDown: 1 }[event.key];
    if (!step) return;
    const all = [...this.buttons.values()];
    const next = all[all.indexOf(document.activeElement) + step];
    if (!next) return;
    event.preventDefault();
    this._focusable(next);
    next.focus();
  }

  /** @param {number} row */
  _mark(row) {
    const button = this.buttons.get(this.data.column.line[row]);
    if (button === this.current) return;
    this.current?.removeAttribute("aria-current");
    this.current = button;
    if (!button) return;
    button.setAttribute("aria-current", "true");
    const { offsetTop, offsetHeight } = button.closest("li");
    const { scrollTop, clientHeight } = this.list;
    const inside = offsetTop >= scrollTop && offsetTop + offsetHeight <= scrollTop + clientHeight;
    if (!inside) this.list.scrollTop = offsetTop - clientHeight / 2; // the list alone, never the page
  }

  /** @param {number} line */
  _chosen(line) {
    for (const [number, button] of this.buttons) button.setAttribute("aria-pressed", String(number === line));
  }
}
