// The one cursor over all views: a row of the run, moved by hovering, pinned by a click, stepped by keys.

const STEP = 1;
const STRIDE = 50;

export class Cursor {
  /** @param {number} rows of the run; @param {number} row where it begins */
  constructor(rows, row) {
    this.rows = rows;
    this.row = row;
    this.pinned = false;
    this.held = false; // by a film that plays: hovering does not move it then
    this.line = 0; // of the program, whose stretches are highlighted; 0 for none
    /** @type {((row: number, source: unknown) => void)[]} */
    this._moved = [];
    /** @type {((line: number) => void)[]} */
    this._chosen = [];
    this._frame = 0;
  }

  /**
   * Call a function after a move, once a picture at most; source is what moved it. Returns a function that ends this.
   *
   * @param {(row: number, source: unknown) => void} listener
   */
  onMove(listener) {
    this._moved.push(listener);
    return () => {
      this._moved = this._moved.filter((other) => other !== listener);
    };
  }

  /**
   * Call a function after a line of the program is chosen.
   *
   * @param {(line: number) => void} listener
   */
  onChoice(listener) {
    this._chosen.push(listener);
  }

  /** @param {number} row @param {unknown} source */
  set(row, source) {
    this.row = Math.min(Math.max(Math.round(row), 0), this.rows - 1);
    this.source = source;
    if (!this._frame) {
      this._frame = requestAnimationFrame(() => {
        this._frame = 0;
        for (const listener of this._moved) listener(this.row, this.source);
      });
    }
  }

  /** Take over another run's rows, and stand at one of them. @param {number} rows @param {number} row */
  resize(rows, row) {
    this.rows = rows;
    this.set(row, "data");
  }

  /** @param {number} row @param {unknown} source */
  hover(row, source) {
    if (!this.pinned && !this.held) this.set(row, source);
  }

  /**
   * Pin the cursor to a row; a click on the row where it is pinned releases it.
   *
   * @param {number} row
   * @param {unknown} source
   */
  pin(row, source) {
    this.pinned = !(this.pinned && row === this.row);
    this.set(row, source);
  }

  /** @param {number} line */
  choose(line) {
    this.line = this.line === line ? 0 : line;
    for (const listener of this._chosen) listener(this.line);
  }

  release() {
    this.pinned = false;
    if (this.line) this.choose(this.line);
    this.set(this.row, "key");
  }

  /**
   * Move the cursor by a key; returns whether the key does so.
   *
   * @param {KeyboardEvent} event
   */
  key(event) {
    const step = event.shiftKey ? STRIDE : STEP;
    /** @type {Record<string, number>} */
    const places = {
      ArrowLeft: this.row - step,
      ArrowRight: this.row + step,
      Home: 0,
      End: this.rows - 1,
    };
    if (event.ctrlKey || event.metaKey || event.altKey) return false;
    if (event.key === "Escape") this.release();
    else if (event.key in places) {
      this.pinned = true; // else the resting mouse would take the cursor back
      this.set(places[event.key], "key");
    } else return false;
    event.preventDefault();
    return true;
  }
}

/**
 * Make an element a slider that moves the cursor by keys, and that says where the cursor is.
 *
 * @param {HTMLElement} element
 * @param {Cursor} cursor
 * @param {string} label
 * @param {(row: number) => string} textAt
 */
export function asSlider(element, cursor, label, textAt) {
  element.tabIndex = 0;
  element.setAttribute("role", "slider");
  element.setAttribute("aria-label", label);
  element.setAttribute("aria-valuemin", "0");
  element.addEventListener("keydown", (event) => cursor.key(event));
  /** @param {number} row */
  const tell = (row) => {
    element.setAttribute("aria-valuemax", String(cursor.rows - 1));
    element.setAttribute("aria-valuenow", String(row));
    element.setAttribute("aria-valuetext", textAt(row));
  };
  tell(cursor.row);
  cursor.onMove(tell);
}
