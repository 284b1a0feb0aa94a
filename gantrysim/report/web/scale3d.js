// The colours of the 3-D view: those of the plan for the error, those of the bead's map for its width.

import { choose } from "./dom.js";
import { placeOf, ScaleBar } from "./scalebar.js";
import { colourAt, theme } from "./theme.js";

const LEVELS = 255;

/** The colours of a scale from 0 to 1 as [red, green, blue]. @param {Stop[]} stops */
function table(stops) {
  return Array.from({ length: LEVELS + 1 }, (_, k) => (colourAt(stops, k / LEVELS).match(/\d+/g) ?? []).map(Number));
}

export class Scale3d {
  /** @param {RunData} data */
  constructor(data) {
    this.data = data;
    this.byWidth = Boolean(data.width) && data.shown !== "path";
    this.bar = new ScaleBar(data, this.byWidth);
    this.element = this.bar.element;
  }

  /** Show the tolerance of other data. */
  update() {
    this.bar.show(this.byWidth);
  }

  get quantity() {
    return this.byWidth ? "the deviation of its width" : "the error of its path";
  }

  /**
   * Buttons that choose the quantity; none where the bead's width is unknown.
   *
   * @param {() => void} changed
   */
  buttons(changed) {
    if (!this.data.width) return [];
    return [
      choose("Colour", [["width", true], ["path error", false]], this.byWidth, (byWidth) => {
        this.byWidth = byWidth;
        this.bar.show(byWidth);
        changed();
      }),
    ];
  }

  /**
   * A function from a row to [red, green, blue].
   *
   * @returns {(row: number) => Rgb}
   */
  painter() {
    const { shares, widths, soft } = theme();
    const colours = table(this.byWidth ? widths : shares);
    const unknown = [1, 3, 5].map((k) => parseInt(soft.slice(k, k + 2), 16));
    const place = placeOf(this.data, this.byWidth);
    return (row) => colours[Math.round(LEVELS * place(row))] || unknown;
  }
}
