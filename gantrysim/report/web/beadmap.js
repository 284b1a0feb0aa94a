// The glue in plan view: the bead as wide as it is laid, over the band that is requested, coloured by its deviation in
// width; and dots, as wide as they lie on the work, coloured by their deviation in volume.

import { digits } from "./data.js";
import { element } from "./dom.js";
import { PlanMap } from "./map.js";
import { colourAt, endOf, placeOn, theme } from "./theme.js";

const LEVELS = 160; // of width, each drawn in one stroke
const DRY = 0.02; // of the nominal width; a narrower bead is none

export class BeadMap {
  constructor(data, cursor, region) {
    this.data = data;
    this.limit = data.width_tolerance; // [%]
    const { x, y, width } = data.column;
    const place = { x: 0, y: 0 };
    this.map = new PlanMap({
      name: data.width ? "Bead as laid, coloured by the deviation of its width" : "Dots as laid, coloured by their volume",
      data,
      cursor,
      region,
      points: (row) => Object.assign(place, { x: x[row], y: y[row] }),
      draw: (context, map, colours) => this._draw(context, map, colours),
      describe: (row) => `t = ${data.time[row].toFixed(3)} s${width ? `, bead width ${data.text("width", row)}` : ""}`,
    });
    this.widest = !width ? 0 : width.reduce((most, value) => (value > most ? value : most), 0);
    this.bar = element("span", { class: "ramp width" });
    this.element = element("figure", { class: "view bead" }, this._caption(), this.map.surface);
  }

  _caption() {
    const { bar, data, limit } = this;
    const { widths } = theme();
    const span = endOf(widths) * limit;
    for (const side of [-1, 1]) {
      const mark = element("i", { title: `tolerance: ${limit} %` });
      mark.style.left = `${100 * placeOn(widths, side)}%`;
      bar.append(mark);
    }
    const scale = element("span", { class: "scale" }, `−${span} %`, bar, `+${span} %`);
    const count = data.dots.length === 1 ? "1 dot" : `${data.dots.length} dots`;
    const dots = data.dots.length ? `, volume of ${count}` : "";
    if (!data.width) return element("figcaption", {}, element("b", {}, "Dots"), `volume of ${count}`, scale);
    return element("figcaption", {}, element("b", {}, "Bead width"), `of ${digits(data.width)} mm${dots}`, scale);
  }

  _draw(context, map, colours) {
    if (this.data.width) this._bead(context, map, colours);
    for (const dot of this.data.dots) {
      context.beginPath();
      context.arc(map.px(dot.x), map.py(dot.y), Math.max(dot.radius * map.scale, 1), 0, 2 * Math.PI);
      // without a requested volume, in the colour of a dot as requested
      context.fillStyle = this._colour(colours, dot.error || 0);
      context.fill();
      Object.assign(context, { strokeStyle: dot.failed ? colours.alarm : colours.soft, lineWidth: dot.failed ? 2 : 1 });
      context.stroke();
    }
  }

  /** Colour of a deviation [%]. */
  _colour(colours, deviation) {
    return colourAt(colours.widths, placeOn(colours.widths, deviation / this.limit));
  }

  _bead(context, map, colours) {
    const { data, widest } = this;
    const { x, y, width } = data.column;
    const nominal = data.width;
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
    const pieces = Array.from({ length: LEVELS + 1 }, () => new Path2D());
    let before = -1;
    for (let row = 0; row < data.rows; row++) {
      const wide = width[row];
      const level = wide > DRY * nominal ? Math.round((LEVELS * wide) / widest) : -1;
      if (level >= 0) {
        const place = [map.px(x[row]), map.py(y[row])];
        if (before !== level) {
          const start = before >= 0 ? row - 1 : row; // pieces of different width touch
          pieces[level].moveTo(map.px(x[start]), map.py(y[start]));
        }
        pieces[level].lineTo(...place);
      }
      before = level;
    }
    pieces.forEach((piece, level) => {
      const wide = (widest * level) / LEVELS;
      const deviation = 100 * (wide / nominal - 1);
      context.strokeStyle = this._colour(colours, deviation);
      context.lineWidth = Math.max(wide * map.scale, 1);
      context.stroke(piece);
    });
  }
}
