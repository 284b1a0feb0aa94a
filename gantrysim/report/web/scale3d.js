// The colours of the 3-D view: those of the plan for the error, those of the bead's map for its width.

import { digits } from "./data.js";
import { element } from "./dom.js";
import { colourAt, endOf, placeOn, theme } from "./theme.js";

const LEVELS = 255;

/** The colours of a scale from 0 to 1 as [red, green, blue]. */
function table(stops) {
  return Array.from({ length: LEVELS + 1 }, (_, k) => colourAt(stops, k / LEVELS).match(/\d+/g).map(Number));
}

export class Scale3d {
  constructor(data) {
    this.data = data;
    this.byWidth = false;
    this.bar = element("span", { class: "ramp" });
    this.low = element("span");
    this.high = element("span");
    this.element = element("span", { class: "scale" }, this.low, this.bar, this.high);
    this._legend();
  }

  get quantity() {
    return this.byWidth ? "the deviation of its width" : "the error of its path";
  }

  /** Buttons that choose the quantity; none where the bead's width is unknown. */
  buttons(changed) {
    if (!this.data.width) return [];
    const buttons = [["error", false], ["width", true]].map(([label, byWidth]) => {
      const button = element("button", { type: "button", "aria-pressed": String(byWidth === this.byWidth) }, label);
      button.addEventListener("click", () => {
        this.byWidth = byWidth;
        buttons.forEach((other) => other.setAttribute("aria-pressed", String(other === button)));
        this._legend();
        changed();
      });
      return button;
    });
    return [element("span", { class: "choice", role: "group", "aria-label": "Colour" }, ...buttons)];
  }

  get _stops() {
    return this.byWidth ? theme().widths : theme().shares;
  }

  _legend() {
    const { data, byWidth, bar, _stops: stops } = this;
    const limit = byWidth ? data.width_tolerance : data.path_tolerance;
    const unit = byWidth ? "%" : "µm";
    const end = digits(endOf(stops) * limit);
    this.low.textContent = byWidth ? `−${end} %` : "0";
    this.high.textContent = byWidth ? `+${end} %` : `≥ ${end} µm`;
    bar.className = byWidth ? "ramp width" : "ramp share";
    bar.replaceChildren();
    for (const value of byWidth ? [-1, 1] : [1]) {
      const mark = element("i", { title: `tolerance: ${digits(limit)} ${unit}` });
      mark.style.left = `${100 * placeOn(stops, value)}%`;
      bar.append(mark);
    }
  }

  /** A function from a row to [red, green, blue]. */
  painter() {
    const { data, byWidth, _stops: stops } = this;
    const colours = table(stops);
    const unknown = theme().soft.match(/[0-9a-f]{2}/gi).map((part) => parseInt(part, 16));
    const { width } = data.column;
    return (row) => {
      const value = byWidth
        ? (100 * (width[row] / data.width - 1)) / data.width_tolerance
        : data.size[row] / data.path_tolerance;
      return value === value ? colours[Math.round(LEVELS * placeOn(stops, value))] : unknown;
    };
  }
}
