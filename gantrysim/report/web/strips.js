// Strips of the errors, the bead and the motion over time or along the path, drawn by uPlot with one cursor and one zoom.

import uPlot from "uplot";
import { asSlider } from "./cursor.js";
import { extent, stretches } from "./data.js";
import { element, sample, toggle } from "./dom.js";
import { gestures } from "./gestures.js";
import { colourOf, onTheme, theme } from "./theme.js";

const TALL = 210; // of the strip of all errors [pixels]
const LOW = 96; // of the others
const HEADING = 20; // above a strip [pixels]
const AHEAD = "100px"; // of the window's edge, at which a strip takes over new data
const SPACE = 0.06; // above and below a line, of its range

/**
 * Labels of an axis: uPlot's own have commas between thousands, and hyphens.
 *
 * @param {uPlot} plot @param {number[]} places
 */
const labels = (plot, places) =>
  places.map((value) => (value === null ? "" : String(Number(value.toPrecision(6))).replace("-", "−")));

/** @template {RunData | ComparedData} [Data=RunData] */
export class Strips {
  /** @param {Data} data @param {Cursor} cursor */
  constructor(data, cursor) {
    this.data = data;
    this.cursor = cursor;
    this.common = true; // one scale for all errors
    this.timed = true; // the abscissa is the time
    this.hidden = new Set();
    this.list = element("div", { class: "strips" });
    this.element = element("div", { class: "view" }, this._caption(), this.list);
    asSlider(this.list, cursor, "Strips of errors, bead and motion", (row) => this._described(row));
    /** The part of the abscissa that is shown, and whether that is the whole run. @type {[number, number]} */
    this._part = [0, 0];
    this._isWhole = true;
    this._sight = new IntersectionObserver((entries) => this._seen(entries), { rootMargin: AHEAD });
    /** @type {Strip[]} */
    this._plots = [];
    /** @type {Record<string, (number | null)[] | Values>} */
    this._values = {};
    this._build();
    cursor.onMove((row) => this._mark(row));
    cursor.onChoice(() => this._redraw());
    onTheme(() => this._build());
    new ResizeObserver(() => this._resize()).observe(this.list);
  }

  _caption() {
    const scale = toggle("errors on one scale", true, (on) => {
      this.common = on;
      this._redraw(true);
    });
    const axis = toggle("over time", true, (on) => {
      this.timed = on;
      axis.textContent = on ? "over time" : "along the path";
      this._build();
    });
    const whole = element("button", { type: "button" }, "whole run");
    whole.addEventListener("click", () => this._show(null));
    return element("div", { class: "bar" }, element("b", {}, "Along the run"), scale, axis, whole);
  }

  get overTime() {
    return this.timed;
  }

  /** @returns {Values} */
  get x() {
    return this.overTime ? this._run.time : this.data.along;
  }

  /** The data of a single run; comparisons have strips of their own. */
  get _run() {
    return /** @type {RunData} */ (this.data);
  }

  /** @param {number} row */
  _described(row) {
    return `t = ${this._run.time[row].toFixed(3)} s, contour error ${this.data.text("contour", row)}`;
  }

  /** Show or hide a link in the strip of all errors, and its own strip. @param {string} name @param {boolean} shown */
  setShown(name, shown) {
    if (shown) this.hidden.delete(name);
    else this.hidden.add(name);
    for (const strip of this._plots) {
      if (strip.names[0] === name && strip.single) strip.box.hidden = !shown;
      strip.names.forEach((series, k) => {
        if (series === name && !strip.single) strip.plot.setSeries(k + 1, { show: shown });
      });
    }
    this._redraw(true);
  }

  /**
   * The strips from top to bottom: names of their series, whether they are a link's alone, and their heading.
   *
   * @returns {StripGroup[]}
   */
  _groups() {
    const errors = this.data.links().map((series) => series.name);
    /** @type {StripGroup[]} */
    const groups = [{ names: errors, own: false, heading: "contour error and its links" }];
    for (const name of errors) if (name !== "contour") groups.push({ names: [name], own: true });
    for (const { name, group } of this.data.series) {
      if (group === "bead" || group === "motion") groups.push({ names: [name], own: false });
    }
    return groups;
  }

  _build() {
    this._clear();
    this.list.replaceChildren();
    const groups = this._groups();
    this._values = {};
    this._plots = groups.map((group, k) => this._strip(group, k === groups.length - 1));
    for (const { box } of this._plots) this._sight.observe(box);
    for (const name of this.hidden) this.setShown(name, false);
    this._show(null);
  }

  _clear() {
    this._sight.disconnect();
    for (const { plot } of this._plots) plot.destroy();
    this._plots = [];
  }

  /** Show other data of the run in the same strips; the part that is shown stays, unless that was the whole run. */
  update() {
    this._values = {};
    for (const strip of this._plots) strip.outdated = true;
    this._show(this._isWhole ? null : this._part);
    for (const strip of this._plots) if (strip.inSight) this._load(strip);
  }

  /** Show the present data in a strip that has those before. @param {Strip} strip */
  _load(strip) {
    const { plot, names } = strip;
    strip.outdated = false;
    plot.setData([this.x, ...names.map((name) => this._known(name))], false);
    const [min, max] = this._part;
    plot.setScale("x", { min, max });
    plot.redraw(false, true);
  }

  /** Strips that come into sight take over what has changed meanwhile. @param {IntersectionObserverEntry[]} entries */
  _seen(entries) {
    for (const { target, isIntersecting } of entries) {
      const strip = this._plots.find(({ box }) => box === target);
      if (!strip) continue;
      strip.inSight = isIntersecting;
      if (!isIntersecting || !strip.outdated) continue;
      this._load(strip);
      this._markSoon();
    }
  }

  /** Take the strips away, with what they listen to in the window. */
  remove() {
    this._clear();
  }

  /** @param {StripGroup} group @param {boolean} last */
  _strip({ names, own, heading: title }, last) {
    const colours = theme();
    const series = names.map((name) => this.data.seriesOf(name));
    const several = names.length > 1;
    const value = element("output", { "aria-live": "off" });
    const { label, unit } = series[0];
    const heading = element("div", { class: "heading" }, title || label, value);
    const single = own && !several;
    if (single) heading.prepend(sample(colourOf(series[0], colours), series[0].dash));
    const box = element("div", { class: "strip", "data-name": names[0] + (several ? "-all" : "") }, heading);
    this.list.append(box);
    const errors = series[0].group === "error";
    /** @type {Omit<Strip, "plot">} */
    const content = { box, names, own, single, errors, value, last, inSight: true, outdated: false };
    /** @type {import("uplot").Options} */
    const options = {
      width: this._width(),
      height: (several ? TALL : LOW) + (last ? 26 : 0),
      legend: { show: false },
      cursor: { y: false, x: true, drag: { x: false, y: false }, points: { size: 7 }, bind: this._unbound() },
      scales: { x: { time: false }, y: { range: (plot) => this._range(content, plot) } },
      axes: [this._axis(colours, last), this._upright(colours, unit)],
      series: [{}, ...series.map((one) => this._line(one, colours, several))],
      hooks: { drawClear: [(plot) => this._shade(plot, colours)], draw: [(plot) => this._limits(content, plot, colours)] },
      padding: [HEADING, 12, last ? 0 : 4, 0],
    };
    const plot = new uPlot(options, [this.x, ...names.map((name) => this._known(name))], box);
    const strip = Object.assign(content, { plot });
    this._listen(strip);
    return strip;
  }

  /** uPlot's own listeners, of which none is needed. */
  _unbound() {
    /** @returns {null} */
    const none = () => null;
    return Object.fromEntries(
      ["mousedown", "mouseup", "click", "dblclick", "mousemove", "mouseleave", "mouseenter"].map((name) => [name, none]),
    );
  }

  /** @param {Theme} colours @param {boolean} last */
  _axis(colours, last) {
    const font = `11px ${getComputedStyle(document.body).fontFamily}`;
    const shown = last ? { label: this.overTime ? "time [s]" : "distance along the path [mm]", labelSize: 16, labelFont: font, size: 26 } : { size: 0 };
    return {
      stroke: colours.soft,
      font,
      grid: { stroke: colours.line, width: 1 },
      ticks: { show: false },
      values: last ? labels : (/** @type {uPlot} */ plot, /** @type {number[]} */ places) => places.map(() => ""),
      ...shown,
    };
  }

  /** @param {Theme} colours @param {string} unit */
  _upright(colours, unit) {
    const font = `11px ${getComputedStyle(document.body).fontFamily}`;
    return {
      stroke: colours.soft,
      font,
      size: 62,
      label: unit,
      labelSize: 14,
      labelFont: font,
      grid: { stroke: colours.line, width: 1 },
      ticks: { show: false },
      space: 26,
      values: labels,
    };
  }

  /** @param {SeriesContent} series @param {Theme} colours @param {boolean} several */
  _line(series, colours, several) {
    const whole = series.name === "contour";
    return {
      stroke: colourOf(series, colours),
      width: several ? (whole ? 2.2 : 1.3) : 1.2,
      dash: several && series.dash?.length ? series.dash : undefined,
      points: { show: false },
      show: !this.hidden.has(series.name) || !several,
    };
  }

  /** The values of a column as uPlot takes them: null where there is none. @param {string} name */
  _known(name) {
    if (!this._values[name]) {
      const values = this.data.column[name];
      this._values[name] = values.some(isNaN) ? Array.from(values, (value) => (isNaN(value) ? null : value)) : values;
    }
    return this._values[name];
  }

  /** @param {uPlot} plot */
  _rows(plot) {
    const { min, max } = plot.scales.x;
    const x = this.x;
    if (min == null || max == null) return [0, x.length - 1];
    return [Math.max(plot.valToIdx(min) - 1, 0), Math.min(plot.valToIdx(max) + 1, x.length - 1)];
  }

  /** @param {Omit<Strip, "plot">} strip @param {uPlot} plot @returns {[number, number]} */
  _range(strip, plot) {
    const [first, last] = plot ? this._rows(plot) : [0, this.data.rows - 1];
    let names = strip.names;
    if (strip.errors && (this.common || !strip.own)) {
      names = this.data.links().map((series) => series.name);
    }
    let low = strip.errors ? 0 : Infinity;
    let high = strip.errors ? 0 : -Infinity;
    for (const name of names.filter((one) => !this.hidden.has(one))) {
      const [least, most] = extent(this.data.column[name], first, last);
      low = Math.min(low, least);
      high = Math.max(high, most);
    }
    if (!strip.errors) low = Math.min(low, 0);
    if (!(high > low)) return [low - 1, low + 1];
    const space = SPACE * (high - low);
    return [low - (low < 0 ? space : 0), high + space];
  }

  /** @param {uPlot} plot @param {number} first @param {number} last @param {string} colour */
  _band(plot, first, last, colour) {
    const x = this.x;
    const left = plot.valToPos(x[first], "x", true);
    const right = plot.valToPos(x[last], "x", true);
    const { top, height } = plot.bbox;
    plot.ctx.fillStyle = colour;
    plot.ctx.fillRect(left, top, Math.max(right - left, 1), height);
  }

  /**
   * Shade where the dispenser is off, and the stretches of the chosen line.
   *
   * @param {uPlot} plot @param {Theme} colours
   */
  _shade(plot, colours) {
    const context = plot.ctx;
    context.save();
    context.beginPath();
    context.rect(plot.bbox.left, plot.bbox.top, plot.bbox.width, plot.bbox.height);
    context.clip();
    context.globalAlpha = 0.35;
    for (const [first, last] of this.data.off) this._band(plot, first, last, colours.line);
    const { line } = this.cursor;
    if (line) {
      context.globalAlpha = 0.3;
      for (const [first, last] of stretches(this.data.rows, (row) => this.data.column.line[row] === line)) {
        this._band(plot, first, last, colours.near);
      }
    }
    context.restore();
  }

  /** Draw zero and the tolerance. @param {Omit<Strip, "plot">} strip @param {uPlot} plot @param {Theme} colours */
  _limits(strip, plot, colours) {
    const { path_tolerance: path, width, width_tolerance: percent } = this.data;
    const quantity = this.data.seriesOf(strip.names[0]).quantity || strip.names[0];
    /** @type {number[]} */
    let limits = [];
    if (quantity === "contour" && path) limits = [-path, path];
    if (quantity === "width" && width && percent) limits = [width * (1 - percent / 100), width * (1 + percent / 100)];
    const context = plot.ctx;
    context.save();
    context.setLineDash([6, 5]);
    Object.assign(context, { strokeStyle: colours.alarm, lineWidth: window.devicePixelRatio || 1 });
    for (const limit of limits) {
      const y = Math.round(plot.valToPos(limit, "y", true));
      if (y < plot.bbox.top || y > plot.bbox.top + plot.bbox.height) continue;
      context.beginPath();
      context.moveTo(plot.bbox.left, y);
      context.lineTo(plot.bbox.left + plot.bbox.width, y);
      context.stroke();
    }
    context.restore();
  }

  /** @param {Strip} strip */
  _listen(strip) {
    const { plot } = strip;
    /** @param {number} x */
    const rowAt = (x) => plot.posToIdx(Math.min(Math.max(x, 0), plot.over.clientWidth));
    gestures(plot.over, this.list, {
      hover: (x) => this.cursor.hover(rowAt(x), this),
      click: (x) => this.cursor.pin(rowAt(x), this),
      dragging: (...box) => {
        const [x0, , x1] = box.length ? box : [0, 0, 0];
        const height = box.length ? plot.over.clientHeight : 0;
        plot.setSelect({ left: Math.min(x0, x1), width: Math.abs(x1 - x0), top: 0, height }, false);
      },
      box: (x0, y0, x1) => this._show([Math.min(x0, x1), Math.max(x0, x1)].map((x) => plot.posToVal(x, "x"))),
      zoom: (factor, x) => {
        const at = plot.posToVal(x, "x");
        const [min, max] = this._part;
        this._show([at - (at - min) / factor, at + (max - at) / factor]);
      },
      pan: (dx) => {
        const shift = plot.posToVal(0, "x") - plot.posToVal(dx, "x");
        const [min, max] = this._part;
        this._show([min + shift, max + shift]);
      },
      reset: () => this._show(null),
    });
  }

  /** Show a part of all strips, within the run; null for all of it. @param {number[] | null} part */
  _show(part) {
    const x = this.x;
    const whole = [x[0], x[x.length - 1]];
    let [min, max] = part || whole;
    const size = Math.min(max - min, whole[1] - whole[0]);
    min = Math.min(Math.max(min, whole[0]), whole[1] - size);
    max = min + size;
    if (!(max > min)) return;
    this._part = [min, max];
    this._isWhole = min <= whole[0] && max >= whole[1];
    for (const { plot, outdated } of this._plots) if (!outdated) plot.setScale("x", { min, max });
    this._markSoon();
  }

  /** The values at the cursor, as a strip's heading has them. @param {string[]} names @param {number} row */
  _valueText(names, row) {
    return this.data.text(names[0], row);
  }

  /** @param {number} row */
  _mark(row) {
    for (const { plot, value, names } of this._plots) {
      plot.setCursor({ left: plot.valToPos(this.x[row], "x"), top: 10 }, false);
      value.textContent = this._valueText(names, row);
    }
  }

  /** Mark the cursor once uPlot has taken over new scales and sizes, which it does at the end of a task. */
  _markSoon() {
    requestAnimationFrame(() => this._mark(this.cursor.row));
  }

  _width() {
    return Math.max(this.list.clientWidth, 200);
  }

  _resize() {
    const width = this._width();
    for (const { plot } of this._plots) if (plot.width !== width) plot.setSize({ width, height: plot.height });
    this._markSoon();
  }

  _redraw(scales = false) {
    for (const { plot, outdated } of this._plots) {
      if (outdated) continue;
      if (scales) {
        const [min, max] = this._part;
        plot.setScale("x", { min, max });
      }
      plot.redraw(false, true);
    }
  }
}
