// The plan view of several runs over one another: their beads as laid, or their paths with errors magnified alike.

import { element, toggle } from "./dom.js";
import { PlanMap } from "./map.js";
import { colourOf } from "./theme.js";

const LINE = 2; // width of a path [pixels]
const LEVELS = 60; // of a bead's width, each drawn in one stroke

export class Overlay {
  /** @param {ComparedData} data @param {Cursor} cursor @param {Region} region */
  constructor(data, cursor, region) {
    this.data = data;
    this.factor = data.magnification;
    this.beads = false;
    this.map = new PlanMap({
      name: "Plan view of the runs over one another",
      data,
      cursor,
      region,
      points: (row) => this._first(row),
      marks: (row) => this._marks(row),
      draw: (context, map, colours) => this._draw(context, map, colours),
      describe: (row) => data.described(row),
    });
    this.element = element("figure", { class: "view plan overlay" }, this._caption(), this.map.surface);
  }

  _caption() {
    const { data } = this;
    const caption = element("figcaption", {}, element("b", {}, "Beads over one another"));
    /** @param {"factor" | "beads"} name @param {unknown} value */
    const change = (name, value) => {
      Object.assign(this, { [name]: value });
      this.map.redraw();
    };
    if (data.magnification > 1) {
      const magnified = toggle(`error × ${data.magnification}`, true, (on) => change("factor", on ? data.magnification : 1), {
        title: "draw the distance of every nozzle from the path magnified",
      });
      caption.append(magnified);
    }
    if (data.quantities.some(({ name }) => name === "width")) {
      const laid = toggle("width as laid", false, (on) => change("beads", on), { title: "draw beads as wide as they are laid" });
      caption.append(laid);
    }
    return caption;
  }

  /** Show other data of the runs, with errors magnified as they are now. */
  update() {
    if (this.factor > 1) this.factor = this.data.magnification;
    this.map.redraw();
  }

  /** @param {number} number @param {boolean} shown */
  setRun(number, shown) {
    if (shown) this.data.hidden.delete(number);
    else this.data.hidden.add(number);
    this.map.redraw();
  }

  /** Position drawn of a run's nozzle at a row: its error magnified. @param {number} run @param {number} row */
  _point(run, row) {
    const { column } = this.data;
    const [x, y, dx, dy] = ["x", "y", "dx", "dy"].map((name) => column[`${name}.${run}`][row]);
    return { x: x + (this.factor - 1) * dx, y: y + (this.factor - 1) * dy };
  }

  /** Where the cursor stands: on the first of the runs shown that has a value there. @param {number} row */
  _first(row) {
    for (const run of this.data.drawn) {
      const point = this._point(run, row);
      if (point.x === point.x) return point;
    }
    return { x: NaN, y: NaN };
  }

  /** @param {number} row */
  _marks(row) {
    return this.data.drawn
      .map((run) => ({ ...this._point(run, row), colour: this.data.runs[run].colour }))
      .filter(({ x }) => x === x);
  }

  /** @param {Context} context @param {PlanMap} map @param {Theme} colours */
  _draw(context, map, colours) {
    const { data } = this;
    for (const run of this.data.drawn) {
      const { x, y } = data.requested[run];
      this._line(context, map, (row) => ({ x: x[row], y: y[row] }));
      Object.assign(context, { strokeStyle: colours.soft, lineWidth: 1 });
      context.setLineDash([]);
      context.stroke();
    }
    for (const run of this.data.drawn) {
      const { colour, dash } = data.runs[run];
      const ink = colourOf({ colour }, colours);
      if (this.beads) this._bead(context, map, run, ink);
      this._line(context, map, (row) => this._point(run, row));
      Object.assign(context, { strokeStyle: ink, lineWidth: LINE, lineCap: "butt" });
      context.setLineDash(dash);
      context.stroke();
    }
    context.setLineDash([]);
    context.lineCap = "round";
  }

  /** @param {Context} context @param {PlanMap} map @param {(row: number) => Point} pointOf */
  _line(context, map, pointOf) {
    context.beginPath();
    let pen = false;
    for (let row = 0; row < this.data.rows; row++) {
      const { x, y } = pointOf(row);
      if (x === x) {
        if (pen) context.lineTo(map.px(x), map.py(y));
        else context.moveTo(map.px(x), map.py(y));
      }
      pen = x === x;
    }
  }

  /**
   * Draw a bead as wide as it is laid, about the position drawn.
   *
   * @param {Context} context @param {PlanMap} map @param {number} run @param {string} ink
   */
  _bead(context, map, run, ink) {
    const width = this.data.column[`width.${run}`];
    const widest = width.reduce((most, value) => (value > most ? value : most), 0);
    const pieces = Array.from({ length: LEVELS + 1 }, () => new Path2D());
    let before = -1;
    for (let row = 0; row < this.data.rows; row++) {
      const { x, y } = this._point(run, row);
      const level = x === x && width[row] > 0 ? Math.round((LEVELS * width[row]) / widest) : -1;
      if (level >= 0) {
        if (before !== level) {
          const from = before >= 0 ? this._point(run, row - 1) : { x, y }; // pieces of different width touch
          pieces[level].moveTo(map.px(from.x), map.py(from.y));
        }
        pieces[level].lineTo(map.px(x), map.py(y));
      }
      before = level;
    }
    context.save();
    Object.assign(context, { strokeStyle: ink, globalAlpha: 0.35, lineCap: "butt" });
    context.setLineDash([]);
    pieces.forEach((piece, level) => {
      context.lineWidth = Math.max(((widest * level) / LEVELS) * map.scale, 1);
      context.stroke(piece);
    });
    context.restore();
  }
}
