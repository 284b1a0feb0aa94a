// The bar of a colour scale with its ends and marks at the tolerance: share of the path's tolerance, or signed width.

import { digits } from "./data.js";
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
    this.limit.textContent = byWidth ? `limit ±${text} %` : `limit ${text} µm${data.path_statistic && ` (${data.path_statistic})`}`;
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
  return (row) => place(widths, (100 * (width[row] / nominal - 1)) / data.width_tolerance);
}
