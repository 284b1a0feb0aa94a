// A map of the work in plan view on a canvas: scales, grid, zoom and pan, and the cursor on a second canvas above it.

import { asSlider } from "./cursor.js";
import { extent, number, stretches } from "./data.js";
import { contextOf, element } from "./dom.js";
import { gestures } from "./gestures.js";
import { around, Texts } from "./texts.js";
import { onTheme, theme } from "./theme.js";

const MARGIN = 1.12; // of the whole path
const REACH = 60; // pixels from the path within which hovering finds it
const SMALLEST = 0.05; // height of a map at the closest zoom [mm]
const SQUAREST = 1.3; // width over height of a map
const WIDEST = 2.4;
const WORST = 9; // size of the mark at the worst place [pixels]
const GRID = 90; // least distance of the lines of the grid [pixels]

/** What the maps of a page show: a centre and a height [mm], shared, so that all show the same part. */
export class Region {
  /** @type {number} */ x;
  /** @type {number} */ y;
  /** @type {number} */ height;

  /** @param {{ x0: number, x1: number, y0: number, y1: number }} box */
  constructor(box) {
    this.box = box;
    /** @type {(() => void)[]} */
    this._listeners = [];
    this.whole = true;
  }

  /** Width over height of the whole. */
  get aspect() {
    return (this.box.x1 - this.box.x0) / (this.box.y1 - this.box.y0);
  }

  /** @param {() => void} listener */
  onChange(listener) {
    this._listeners.push(listener);
  }

  /**
   * Show the part around a point; without one the whole.
   *
   * @param {number} [x]
   * @param {number} [y]
   * @param {number} [height]
   */
  show(x, y, height) {
    this.whole = x === undefined;
    Object.assign(this, { x, y, height: height && Math.max(height, SMALLEST) });
    for (const listener of this._listeners) listener();
  }
}

/**
 * The part of the work that columns of x and y [mm] cover, with a margin, at least as wide as a bead.
 *
 * @param {ArrayLike<number>[]} xs
 * @param {ArrayLike<number>[]} ys
 * @param {number | null} width
 */
export function regionOf(xs, ys, width) {
  /** @param {ArrayLike<number>[]} columns */
  const box = (columns) => {
    const extents = columns.map((values) => extent(values));
    return [Math.min(...extents.map(([low]) => low)), Math.max(...extents.map(([, high]) => high))];
  };
  const [x0, x1] = box(xs);
  const [y0, y1] = box(ys);
  const margin = Math.max(0.02 * Math.max(x1 - x0, y1 - y0), width || 0, 1e-3);
  return new Region({ x0: x0 - margin, x1: x1 + margin, y0: y0 - margin, y1: y1 + margin });
}

/**
 * One map. `points` has x and y [mm] at which rows are found, `draw(context, map, colours)` draws below the cursor, and
 * `describe(row)` is the text alternative at a row. `marks(row)` may give further points with a colour.
 */
export class PlanMap {
  /** @type {number} */ scale;
  /** @type {number} */ x;
  /** @type {number} */ y;
  /** @type {number} size of the map [pixels] */ width;
  /** @type {number} */ height;
  /** @type {Texts} */ texts;
  /** Numbers of the grid, and where they stand [pixels]. @type {[string, number, number][]} */ ticks;

  /** @param {MapOptions} options */
  constructor(options) {
    const { name, data, cursor, region, points, draw, describe, marks } = options;
    this.data = data;
    this.cursor = cursor;
    this.region = region;
    this.points = points;
    this.draw = draw;
    this.describe = describe;
    this.marks = marks;
    this.base = element("canvas", { "aria-hidden": "true" });
    this.top = element("canvas", { "aria-hidden": "true" });
    this.surface = element("div", { class: "surface" }, this.base, this.top);
    this.surface.style.aspectRatio = String(Math.min(Math.max(this.region.aspect, SQUAREST), WIDEST));
    asSlider(this.surface, cursor, name, describe);
    this.cursor.onMove(() => this._mark());
    this.cursor.onChoice(() => this.redraw());
    this.region.onChange(() => this.redraw());
    onTheme(() => this.redraw());
    new ResizeObserver(() => this.redraw()).observe(this.surface);
    gestures(this.surface, this.surface, {
      hover: (x, y) => this._find(x, y, (row) => this.cursor.hover(row, this)),
      click: (x, y) => this._find(x, y, (row) => this.cursor.pin(row, this)),
      zoom: (factor, x, y) => this._zoom(factor, x, y),
      pan: (dx, dy) => this._shift(dx, dy),
      dragging: (...box) => this._mark(box),
      box: (x0, y0, x1, y1) => this._zoomTo(x0, y0, x1, y1),
      reset: () => this.region.show(),
    });
  }

  /** Position on the map of a point of the work [pixels]. @param {number} x */
  px(x) {
    return this.width / 2 + (x - this.x) * this.scale;
  }

  /** @param {number} y */
  py(y) {
    return this.height / 2 - (y - this.y) * this.scale;
  }

  redraw() {
    this.width = this.surface.clientWidth;
    this.height = this.surface.clientHeight;
    if (!this.width || !this.height) return;
    const { box, whole } = this.region;
    const fit = Math.min(this.width / (box.x1 - box.x0), this.height / (box.y1 - box.y0)) / MARGIN;
    this.scale = whole ? fit : this.height / this.region.height;
    this.x = whole ? (box.x0 + box.x1) / 2 : this.region.x;
    this.y = whole ? (box.y0 + box.y1) / 2 : this.region.y;
    const colours = theme();
    const context = this._cleared(this.base);
    this._grid(context, colours);
    context.lineCap = "round";
    context.lineJoin = "round";
    this.texts = new Texts(context, this.width, this.height);
    this.draw(context, this, colours);
    this._numbers(context, colours);
    this._mark();
  }

  /** @param {HTMLCanvasElement} canvas */
  _cleared(canvas) {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(this.width * ratio);
    const height = Math.round(this.height * ratio);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const context = contextOf(canvas);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    return context;
  }

  /** @param {Context} context @param {Theme} colours */
  _grid(context, colours) {
    const least = GRID / this.scale;
    const decade = 10 ** Math.floor(Math.log10(least));
    const step = [1, 2, 5].map((digit) => digit * decade).find((size) => size >= least) ?? 10 * decade;
    const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    Object.assign(context, { strokeStyle: colours.line, lineWidth: 1 });
    context.font = `11px ${getComputedStyle(document.body).fontFamily}`;
    context.beginPath();
    this.ticks = [];
    /** @param {number} middle @param {number} half */
    const lines = (middle, half) => {
      const places = [];
      for (let k = Math.ceil((middle - half) / step); k * step <= middle + half; k++) places.push(k * step);
      return places;
    };
    for (const x of lines(this.x, this.width / 2 / this.scale)) {
      const px = Math.round(this.px(x)) + 0.5;
      context.moveTo(px, 0);
      context.lineTo(px, this.height);
      this.ticks.push([number(x, decimals), px + 3, this.height - 9]);
    }
    for (const y of lines(this.y, this.height / 2 / this.scale)) {
      const py = Math.round(this.py(y)) + 0.5;
      context.moveTo(0, py);
      context.lineTo(this.width, py);
      this.ticks.push([number(y, decimals), 4, py - 8]);
    }
    context.stroke();
  }

  /** The numbers of the grid, where nothing else is written. @param {Context} context @param {Theme} colours */
  _numbers(context, colours) {
    const looks = { fillStyle: colours.soft, halo: colours.paper };
    this.texts.write("mm", [[4, this.height - 9, "left"]], looks);
    for (const [text, x, y] of this.ticks) this.texts.write(text, [[x, y, "left"]], looks);
  }

  /**
   * Mark where the dispenser first opens and last closes.
   *
   * @param {Context} context
   * @param {(row: number) => Point} point
   * @param {Theme} colours
   */
  markEnds(context, point, colours) {
    const { data } = this;
    const rows = stretches(data.rows, (row) => data.column.dispense[row]);
    if (!rows.length) return;
    context.fillStyle = colours.ink;
    /** @type {[number, string][]} */
    const ends = [[rows[0][0], "start"], [rows[rows.length - 1][1], "end"]];
    for (const [row, name] of ends) {
      const { x, y } = point(row);
      context.beginPath();
      context.arc(this.px(x), this.py(y), 3.5, 0, 2 * Math.PI);
      context.fill();
      this.texts.write(name, around(this.px(x), this.py(y), 8), { fillStyle: colours.ink, halo: colours.paper });
    }
  }

  /**
   * Mark the verdict's worst place by a triangle above it, with a text.
   *
   * @param {Context} context @param {number} px @param {number} py @param {Theme} colours @param {string} text
   */
  markWorst(context, px, py, colours, text) {
    context.beginPath();
    context.moveTo(px, py - 6);
    context.lineTo(px - 0.6 * WORST, py - 6 - WORST);
    context.lineTo(px + 0.6 * WORST, py - 6 - WORST);
    context.closePath();
    const ink = "passes" in this.data && this.data.passes ? colours.ink : colours.alarm;
    Object.assign(context, { fillStyle: ink, strokeStyle: colours.paper, lineWidth: 1.5 });
    context.fill();
    context.stroke();
    /** @type {TextPlace[]} */
    const places = [[px + WORST, py - 12, "left"], [px - WORST, py - 12, "right"], [px, py - 26, "center"]];
    this.texts.write(text, places, { fillStyle: ink, halo: colours.paper, always: true });
    // of the triangle, and of the cursor that begins there
    this.texts.keep([px - WORST, py - 6 - WORST, px + WORST, py + WORST]);
  }

  /**
   * Draw the cursor, and the box of a drag.
   *
   * @param {number[]} box
   */
  _mark(box = []) {
    if (!this.scale) return;
    const context = this._cleared(this.top);
    const colours = theme();
    const { x, y } = this.points(this.cursor.row);
    const px = this.px(x);
    const py = this.py(y);
    context.beginPath();
    context.moveTo(px, 0);
    context.lineTo(px, this.height);
    context.moveTo(0, py);
    context.lineTo(this.width, py);
    Object.assign(context, { strokeStyle: colours.soft, lineWidth: 0.6 });
    context.stroke();
    this._ring(context, px, py, colours, colours.ink);
    for (const mark of this.marks ? this.marks(this.cursor.row) : []) {
      this._ring(context, this.px(mark.x), this.py(mark.y), colours, mark.colour || colours.ink);
    }
    if (this.cursor.pinned) {
      context.beginPath();
      context.arc(px, py, 2.5, 0, 2 * Math.PI);
      context.fillStyle = colours.ink;
      context.fill();
    }
    if (box.length) {
      const [x0, y0, x1, y1] = box;
      context.strokeStyle = colours.ink;
      context.lineWidth = 1;
      context.strokeRect(x0, y0, x1 - x0, y1 - y0);
    }
  }

  /** @param {Context} context @param {number} px @param {number} py @param {Theme} colours @param {string} ink */
  _ring(context, px, py, colours, ink) {
    /** @type {[number, string][]} */
    const rings = [[5, colours.paper], [2.5, ink]];
    for (const [size, colour] of rings) {
      context.beginPath();
      context.arc(px, py, 7, 0, 2 * Math.PI);
      Object.assign(context, { strokeStyle: colour, lineWidth: size });
      context.stroke();
    }
  }

  /** @param {number} px @param {number} py @param {(row: number) => void} found */
  _find(px, py, found) {
    let nearest = -1;
    let least = REACH * REACH;
    for (let row = 0; row < this.data.rows; row++) {
      const { x, y } = this.points(row);
      const dx = this.px(x) - px;
      const dy = this.py(y) - py;
      const square = dx * dx + dy * dy;
      if (square < least) {
        least = square;
        nearest = row;
      }
    }
    if (nearest >= 0) found(nearest);
  }

  /** @param {number} factor @param {number} px @param {number} py */
  _zoom(factor, px, py) {
    const x = this.x + (px - this.width / 2) / this.scale;
    const y = this.y - (py - this.height / 2) / this.scale;
    const height = this.height / this.scale / factor;
    const scale = this.height / Math.max(height, SMALLEST);
    this.region.show(x - (px - this.width / 2) / scale, y + (py - this.height / 2) / scale, height);
  }

  /** @param {number} dx @param {number} dy */
  _shift(dx, dy) {
    this.region.show(this.x - dx / this.scale, this.y + dy / this.scale, this.height / this.scale);
  }

  /** @param {number} x0 @param {number} y0 @param {number} x1 @param {number} y1 */
  _zoomTo(x0, y0, x1, y1) {
    const wide = Math.abs(x1 - x0) / this.scale;
    const high = Math.abs(y1 - y0) / this.scale;
    const x = this.x + ((x0 + x1) / 2 - this.width / 2) / this.scale;
    const y = this.y - ((y0 + y1) / 2 - this.height / 2) / this.scale;
    this.region.show(x, y, Math.max(high, (wide * this.height) / this.width));
  }
}
