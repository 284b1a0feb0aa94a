// The glue in plan view: the bead as wide as it is laid, over the band that is requested, coloured by its deviation in
// width; and dots, as wide as they lie on the work, coloured by their deviation in volume.

import { digits } from "./data.js";
import { choose, element, within } from "./dom.js";
import { PlanMap } from "./map.js";
import { placeOf, ScaleBar } from "./scalebar.js";
import { colourAt, placeOn } from "./theme.js";

const LEVELS = 160; // of width, each drawn in one stroke
const SHADES = 96; // of a scale
const DRY = 0.02; // of the nominal width; a narrower bead is none

export class BeadMap {
  /** @type {number} largest width [mm] */ widest;
  /** @type {ScaleBar} */ scale;

  /** @param {RunData} data @param {Cursor} cursor @param {Region} region */
  constructor(data, cursor, region) {
    this.data = data;
    this.byError = Boolean(data.width) && data.shown === "path";
    const place = { x: 0, y: 0 };
    this.map = new PlanMap({
      name: data.width ? "Bead as laid, coloured by the deviation of its width" : "Dots as laid, coloured by their volume",
      data,
      cursor,
      region,
      points: (row) => Object.assign(place, { x: data.column.x[row], y: data.column.y[row] }),
      draw: (context, map, colours) => this._draw(context, map, colours),
      describe: (row) => `t = ${data.time[row].toFixed(3)} s${data.column.width ? `, bead width ${data.text("width", row)}` : ""}`,
    });
    this.element = element("figure", { class: "view bead" }, this._caption(), this.map.surface);
  }

  _caption() {
    const { data } = this;
    const { width } = data.column;
    this.widest = !width ? 0 : width.reduce((most, value) => (value > most ? value : most), 0);
    this.scale = new ScaleBar(data, !this.byError);
    const scale = this.scale.element;
    const count = data.dots.length === 1 ? "1 dot" : `${data.dots.length} dots`;
    if (!data.width) return element("figcaption", {}, element("b", {}, "Dots"), `volume of ${count}`, scale);
    const choice = choose("Colour", [["width", false], ["path error", true]], this.byError, (byError) => {
      this.byError = byError;
      this.scale.show(!byError);
      this.map.redraw();
    });
    const dots = data.dots.length ? `, ${count}` : "";
    return element("figcaption", {}, element("b", {}, "Bead"), `${digits(data.width)} mm wide${dots}`, choice, scale);
  }

  /** Show other data of the run. */
  update() {
    within(this.element, "figcaption").replaceWith(this._caption());
    this.map.redraw();
  }

  /** @param {Context} context @param {PlanMap} map @param {Theme} colours */
  _draw(context, map, colours) {
    if (this.data.width) this._bead(context, map, colours);
    for (const dot of this.data.dots) {
      context.beginPath();
      context.arc(map.px(dot.x), map.py(dot.y), Math.max(dot.radius * map.scale, 1), 0, 2 * Math.PI);
      // without a requested volume, in the colour of a dot as requested
      context.fillStyle = colourAt(colours.widths, placeOn(colours.widths, (dot.error || 0) / this.data.width_tolerance));
      context.fill();
      Object.assign(context, { strokeStyle: dot.failed ? colours.alarm : colours.soft, lineWidth: dot.failed ? 2 : 1 });
      context.stroke();
    }
    this._passes(context, map, colours);
    const { x, y } = this.data.column;
    /** @param {number} row */
    const point = (row) => ({ x: x[row], y: y[row] });
    const { worst } = this.data;
    map.markWorst(context, map.px(x[worst]), map.py(y[worst]), colours, "worst");
    map.markEnds(context, point, colours);
  }

  /** The needle's way through its own glue. @param {Context} context @param {PlanMap} map @param {Theme} colours */
  _passes(context, map, colours) {
    const { x, y } = this.data.column;
    context.beginPath();
    for (const [first, last] of this.data.ploughed) {
      context.moveTo(map.px(x[first]), map.py(y[first]));
      for (let row = first; row <= last; row++) context.lineTo(map.px(x[row]), map.py(y[row]));
    }
    for (const [strokeStyle, lineWidth] of [[colours.paper, 5], [colours.alarm, 2.5]]) {
      Object.assign(context, { strokeStyle, lineWidth });
      context.stroke();
    }
  }

  /** @param {Context} context @param {PlanMap} map @param {Theme} colours */
  _bead(context, map, colours) {
    const { data, widest } = this;
    const { x, y, width } = data.column;
    const nominal = data.width ?? NaN;
    context.beginPath();
    let pen = false;
    data.requested.x.forEach((px, k) => {
      const known = px === px;
      if (known && pen) context.lineTo(map.px(px), map.py(data.requested.y[k]));
      else if (known) context.moveTo(map.px(px), map.py(data.requested.y[k]));
      pen = known;
    });
    Object.assign(context, { strokeStyle: colours.line, lineWidth: nominal * map.scale });
    context.stroke();
    // strokes of one width and one colour each, by both
    /** @type {Map<number, { path: Path2D, wide: number, shade: number }>} */
    const pieces = new Map();
    const place = placeOf(data, !this.byError);
    let before = -1; // no piece
    for (let row = 0; row < data.rows; row++) {
      const wide = width[row];
      if (!(wide > DRY * nominal)) {
        before = -1;
        continue;
      }
      const level = Math.max(Math.round((LEVELS * wide) / widest), 1);
      const share = place(row);
      const shade = share === share ? Math.round(SHADES * share) : -1;
      const key = level * 1000 + shade; // level is 1 at least
      const piece = pieces.get(key) ?? { path: new Path2D(), wide: (widest * level) / LEVELS, shade };
      pieces.set(key, piece);
      const { path } = piece;
      if (before !== key) {
        const start = before < 0 ? row : row - 1; // pieces of different width touch
        path.moveTo(map.px(x[start]), map.py(y[start]));
      }
      path.lineTo(map.px(x[row]), map.py(y[row]));
      before = key;
    }
    const stops = this.byError ? colours.shares : colours.widths;
    for (const { path, wide, shade } of pieces.values()) {
      context.strokeStyle = shade < 0 ? colours.line : colourAt(stops, shade / SHADES);
      context.lineWidth = Math.max(wide * map.scale, 1);
      context.stroke(path);
    }
  }
}
