// The bar of a colour scale with its ends and marks at the tolerance: share of the path's tolerance, or signed width.

import { digits, stretches } from "./data.js";
import { element } from "./dom.js";
import { endOf, placeOn, theme } from "./theme.js";

export class ScaleBar {
  /** @param {RunData} data @param {boolean} byWidth */
  constructor(data, byWidth) {
    this.data = data;
    this.bar = element("span");
    this.low = element("span");
    this.high = element("span");
    this.limit = element("small");
    const ramp = element("span", { class: "limited" }, this.bar, this.limit);
    this.element = element("span", { class: "scale" }, this.low, ramp, this.high);
    this.show(byWidth);
  }

  /** @param {boolean} byWidth */
  show(byWidth) {
    const { data, bar } = this;
    const stops = byWidth ? theme().widths : theme().shares;
    const limit = byWidth ? data.width_tolerance : data.path_tolerance;
    const end = Number(digits(endOf(stops) * limit)); // without zeros at its end
    this.low.textContent = byWidth ? `−${end} %` : "0";
    this.high.textContent = byWidth ? `+${end} %` : `${end} µm`;
    const text = Number(digits(limit)); // without zeros at its end
    const statistic = data.path_statistic && ` (${data.path_statistic})`;
    this.limit.textContent = byWidth ? `limit ±${text} %` : `limit ${text} µm${statistic}, not linear`;
    bar.className = `ramp ${byWidth ? "width" : "share"}`;
    bar.replaceChildren();
    for (const value of byWidth ? [-1, 1] : [1]) {
      const mark = element("i", { title: `tolerance: ${digits(limit)} ${byWidth ? "%" : "µm"}` });
      mark.style.left = `${100 * placeOn(stops, value)}%`;
      bar.append(mark);
    }
  }
}

/**
 * A function from a row to the place of its colour on its scale, 0 to 1, NaN where it is not known.
 *
 * @param {RunData} data @param {boolean} byWidth @returns {(row: number) => number}
 */
export function placeOf(data, byWidth) {
  const { widths, shares } = theme();
  const { width } = data.column;
  /** @param {Stop[]} stops @param {number} value */
  const place = (stops, value) => (value === value ? placeOn(stops, value) : NaN);
  if (!byWidth) return (row) => place(shares, data.size[row] / data.path_tolerance);
  const nominal = data.width ?? NaN;
  const ends = endsOf(data);
  return (row) => ends[row] ? NaN : place(widths, (100 * (width[row] / nominal - 1)) / data.width_tolerance);
}

/** Whether a row lies so near to a start or a stop that its width is not judged. @param {RunData} data */
function endsOf(data) {
  const ends = new Uint8Array(data.rows);
  if (!data.unjudged_ends) return ends;
  const { x, y, z, dispense } = data.column;
  ends.fill(1);
  for (const [first, last] of stretches(data.rows, (row) => dispense[row])) {
    ends.fill(0, first, last + 1);
    const [start, stop] = data.unjudged_ends;
    /** @type {[number, number, number, number][]} */
    const both = [[first, last, 1, start], [last, first, -1, stop]];
    for (const [from, to, step, length] of both) {
      let way = 0;
      for (let row = from; way <= length; row += step) {
        ends[row] = 1;
        if (row === to) break;
        const next = row + step;
        way += Math.hypot(x[next] - x[row], y[next] - y[row], z ? z[next] - z[row] : 0);
      }
    }
  }
  return ends;
}
