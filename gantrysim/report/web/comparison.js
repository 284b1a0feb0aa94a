// The viewer of several runs: their beads and paths over one another, strips of both, one cursor over the common place.

import { ComparedData } from "./compared.js";
import { ComparedReadout } from "./comparedreadout.js";
import { Cursor } from "./cursor.js";
import { element, within } from "./dom.js";
import { regionOf } from "./map.js";
import { Overlay } from "./overlay.js";
import { Strips } from "./strips.js";

/**
 * Strips in which each quantity has a line for every run.
 *
 * @extends {Strips<ComparedData>}
 */
export class ComparedStrips extends Strips {
  _caption() {
    const scale = super._caption();
    // the abscissa is what the runs have in common
    scale.querySelectorAll("button")[1].remove();
    within(scale, "b").textContent = this.data.by_path ? "Along the path" : "Over time";
    return scale;
  }

  get x() {
    return this.data.along;
  }

  get overTime() {
    return !this.data.by_path;
  }

  /** @param {number} row */
  _described(row) {
    return this.data.described(row);
  }

  _groups() {
    const { quantities, runs } = this.data;
    return quantities.map(({ name, label, group }) => ({
      names: runs.map((run, k) => `${name}.${k}`),
      own: group === "error" && name !== "contour",
      heading: name === "contour" ? "contour error" : label,
    }));
  }

  /** @param {string[]} names @param {number} row */
  _valueText(names, row) {
    return names.map((name) => this.data.text(name, row)).join("  |  ");
  }

  /** @param {number} number @param {boolean} shown */
  setRun(number, shown) {
    for (const series of this.data.series) if (series.run === number) this.setShown(series.name, shown);
  }
}

/** @param {HTMLElement} place @param {ComparedContent} content */
export function showComparison(place, content) {
  const data = new ComparedData(content);
  const cursor = new Cursor(data.rows, data.worst);
  /** @param {string} name */
  const columns = (name) => data.runs.map((run, k) => data.column[`${name}.${k}`]);
  const region = regionOf(columns("x"), columns("y"), data.width);
  const strips = new ComparedStrips(data, cursor);
  const overlay = new Overlay(data, cursor, region);
  const readout = new ComparedReadout(data, cursor, (number, shown) => {
    strips.setRun(number, shown);
    overlay.setRun(number, shown);
  });
  const views = element("div", { class: "views" }, overlay.element);
  place.append(readout.element, views, strips.element);
  return cursor;
}
