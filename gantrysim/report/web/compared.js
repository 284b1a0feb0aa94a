// The data of several runs, at places that they have in common, see gantrysim/compare/runs/overlay_data.py.

import { decode, named, number } from "./data.js";

export class ComparedData {
  /** @type {number} */ rows;
  /** @type {boolean} */ by_path;
  /** @type {RunLooks[]} */ runs;
  /** @type {SeriesContent[]} */ quantities;
  /** @type {number} */ magnification;
  /** @type {number | null} */ path_tolerance;
  /** @type {number | null} */ width;
  /** @type {number | null} */ width_tolerance;
  /** @type {Columns} */ column;
  /** @type {(SeriesContent & { quantity: string, run: number })[]} */ series;
  /** @type {Values} */ along;
  /** @type {Stretch[]} */ off;
  /** @type {number} */ worst;
  /** @type {Line[]} */ requested;
  /** @type {number[] | null} */ gaps;
  /** Numbers of the runs that are not drawn. @type {Set<number>} */ hidden = new Set();

  /** @param {ComparedContent} content */
  constructor(content) {
    this.load(content);
  }

  /**
   * Take over the content of runs, in place of other ones'.
   *
   * @param {ComparedContent} content
   */
  load(content) {
    Object.assign(this, content);
    this.column = {};
    for (const name of Object.keys(content.columns)) this.column[name] = decode(content.columns[name], content.rows);
    const nothing = new Float64Array(content.rows).fill(NaN);
    this.series = content.quantities.flatMap((quantity) =>
      content.runs.map(({ colour, dash }, run) => {
        const name = `${quantity.name}.${run}`;
        this.column[name] = this.column[name] || nothing; // a run may lack a link
        return { ...quantity, name, quantity: quantity.name, run, colour, dash };
      }),
    );
    this.along = this.column.place;
    this.off = [];
    this.worst = content.worst ?? this._worst(); // of the first run, by its verdict
    this.requested = content.runs.map((run, k) => {
      const [x, y, dx, dy] = ["x", "y", "dx", "dy"].map((name) => this.column[`${name}.${k}`]);
      return { x: x.map((value, row) => value - dx[row]), y: y.map((value, row) => value - dy[row]) };
    });
  }

  /** Numbers of the runs that are drawn. */
  get drawn() {
    return this.runs.map((run, k) => k).filter((k) => !this.hidden.has(k));
  }

  /** The bead of a run, NaN where it has none. @param {number} run @returns {BeadInSpace} */
  beadOf(run) {
    const { rows, column } = this;
    /** @param {string} name */
    const values = (name) => column[`${name}.${run}`];
    const { width } = this;
    const dispense = values("x").map((x) => (isNaN(x) ? 0 : 1));
    const z = values("z") ?? new Float64Array(rows); // of a flat run
    const columns = { x: values("x"), y: values("y"), z, dispense, width: values("width"), height: values("height") };
    return { rows, column: columns, width, space: { gap: this.gaps?.[run] ?? 0 } };
  }

  /** The row of the largest contour error of any run, among those where all have one if there are any. */
  _worst() {
    const errors = this.runs.map((run, k) => this.column[`contour.${k}`]);
    /** @param {number} row */
    const largest = (row) => Math.max(...errors.map((values) => Math.abs(values[row]) || 0));
    /** @param {number} row */
    const all = (row) => errors.every((values) => values[row] === values[row]);
    const rows = Array.from({ length: this.rows }, (value, row) => row);
    const common = rows.filter(all);
    return (common.length ? common : rows).reduce((worst, row) => (largest(row) > largest(worst) ? row : worst));
  }

  /** @param {string} name */
  seriesOf(name) {
    return named(this.series, name);
  }

  links() {
    return this.series.filter((series) => series.group === "error");
  }

  /** A value as text with its unit; a dash where there is none. @param {string} name @param {number} row */
  text(name, row) {
    const { decimals, unit } = this.seriesOf(name);
    const value = this.column[name][row];
    return isNaN(value) ? "–" : `${number(value, decimals)} ${unit}`;
  }

  /**
   * The second run's value less the first one's, as text.
   *
   * @param {SeriesContent} quantity
   * @param {number} row
   */
  differenceText({ name, decimals, unit }, row) {
    const value = this.column[`${name}.1`][row] - this.column[`${name}.0`][row];
    return isNaN(value) ? "–" : `${number(value, decimals)} ${unit}`;
  }

  /** @param {number} row */
  placeText(row) {
    return this.by_path ? `s = ${this.along[row].toFixed(2)} mm` : `t = ${this.along[row].toFixed(3)} s`;
  }

  /** @param {number} row */
  described(row) {
    const errors = this.runs.map(({ name }, k) => `${name} ${this.text(`contour.${k}`, row)}`);
    return `${this.placeText(row)}, contour error ${errors.join(", ")}`;
  }
}
