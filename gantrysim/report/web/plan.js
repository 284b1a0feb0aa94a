// The plan view: the nozzle's path coloured by the size of its error.

import { stretches } from "./data.js";
import { element, toggle, within } from "./dom.js";
import { PlanMap } from "./map.js";
import { placeOf, ScaleBar } from "./scalebar.js";
import { colourAt } from "./theme.js";

const COLOURS = 48;

export class Plan {
  /** @param {RunData} data @param {Cursor} cursor @param {Region} region */
  constructor(data, cursor, region) {
    this.data = data;
    this.cursor = cursor;
    this.factor = data.magnification;
    this.place = { x: 0, y: 0 };
    this.map = new PlanMap({
      name: "Plan view: the nozzle's path, coloured by its error",
      data,
      cursor,
      region,
      points: (row) => this._point(row),
      draw: (context, map, colours) => this._draw(context, map, colours),
      describe: (row) => `t = ${data.time[row].toFixed(3)} s, contour error ${data.text("contour", row)}`,
    });
    this.element = element("figure", { class: "view plan" }, this._caption(), this.map.surface);
  }

  /** Show other data of the run, with errors magnified as they are now. */
  update() {
    if (this.factor > 1) this.factor = this.data.magnification;
    within(this.element, "figcaption").replaceWith(this._caption());
    this.map.redraw();
  }

  /** Position drawn of the nozzle at a row: its error magnified. @param {number} row */
  _point(row) {
    const { factor, place } = this;
    const { x, y, dx, dy } = this.data.column;
    const known = dx[row] === dx[row] && factor > 1;
    place.x = known ? x[row] + (factor - 1) * dx[row] : x[row];
    place.y = known ? y[row] + (factor - 1) * dy[row] : y[row];
    return place;
  }

  _caption() {
    const { data } = this;
    const scale = new ScaleBar(data, false).element;
    const caption = element("figcaption", {}, element("b", {}, "Error of the path"), scale);
    if (data.magnification > 1) {
      const label = `error × ${data.magnification}`;
      /** @param {boolean} on */
      const change = (on) => {
        this.factor = on ? data.magnification : 1;
        this.map.redraw();
      };
      caption.append(toggle(label, this.factor > 1, change, { title: "draw the nozzle's distance from the path magnified" }));
    }
    return caption;
  }

  /** @param {Context} context @param {PlanMap} map @param {Theme} colours */
  _draw(context, map, colours) {
    const { data, cursor } = this;
    const { x, y } = data.requested;
    this._path(context, map, (k) => [x[k], y[k]], 0, x.length - 1);
    Object.assign(context, { strokeStyle: colours.soft, lineWidth: 1 });
    context.stroke();
    const chosen = cursor.line ? stretches(data.rows, (row) => data.column.line[row] === cursor.line) : [];
    for (const [first, last] of chosen) {
      this._path(context, map, (row) => this._drawn(row), first, last);
      Object.assign(context, { strokeStyle: colours.ink, lineWidth: 9 });
      context.stroke();
      Object.assign(context, { strokeStyle: colours.paper, lineWidth: 6 });
      context.stroke();
    }
    this._coloured(context, map, colours);
    this._ends(context, map, colours);
  }

  /** @param {number} row */
  _drawn(row) {
    const { x, y } = this._point(row);
    return [x, y];
  }

  /** @param {Context} context @param {PlanMap} map @param {(row: number) => number[]} point */
  _path(context, map, point, first = 0, last = this.data.rows - 1) {
    context.beginPath();
    let pen = false;
    for (let row = first; row <= last; row++) {
      const [x, y] = point(row);
      if (x === x) {
        if (pen) context.lineTo(map.px(x), map.py(y));
        else context.moveTo(map.px(x), map.py(y));
      }
      pen = x === x;
    }
  }

  /** Draw the path in pieces of equal colour. @param {Context} context @param {PlanMap} map @param {Theme} colours */
  _coloured(context, map, colours) {
    const { data } = this;
    const pieces = Array.from({ length: COLOURS }, () => new Path2D());
    const place = placeOf(data, false);
    let before = -1;
    /** @type {[number, number]} */
    let from = [0, 0];
    for (let row = 0; row < data.rows; row++) {
      const size = data.size[row];
      if (size !== size) {
        before = -1;
        continue;
      }
      const { x, y } = this._point(row);
      /** @type {[number, number]} */
      const to = [map.px(x), map.py(y)];
      const k = Math.min(Math.floor(COLOURS * place(row)), COLOURS - 1);
      if (before >= 0) {
        if (before !== k) pieces[k].moveTo(...from);
        pieces[k].lineTo(...to);
      } else pieces[k].moveTo(...to);
      before = k;
      from = to;
    }
    context.lineWidth = 3;
    pieces.forEach((piece, k) => {
      context.strokeStyle = colourAt(colours.shares, (k + 0.5) / COLOURS);
      context.stroke(piece);
    });
  }

  /**
   * Mark where the dispenser first opens and last closes, and the verdict's worst place.
   *
   * @param {Context} context @param {PlanMap} map @param {Theme} colours
   */
  _ends(context, map, colours) {
    const { data } = this;
    const { x, y } = this._point(data.worst);
    map.markWorst(context, map.px(x), map.py(y), colours, data.text("contour", data.worst));
    map.markEnds(context, (row) => this._point(row), colours);
  }
}
