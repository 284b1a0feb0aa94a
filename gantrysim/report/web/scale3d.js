// The colours of the 3-D view: those of the plan for the error, those of the bead's map for its width.

import { digits } from "./data.js";
import { choose, element } from "./dom.js";
import { mixed, onTheme, theme, WIDTH_SPAN } from "./theme.js";

const LEVELS = 255;

/** The colours of a ramp from 0 to 1 as [red, green, blue]. */
function table(ramp) {
  return Array.from({ length: LEVELS + 1 }, (_, k) => mixed(ramp, k / LEVELS).match(/\d+/g).map(Number));
}

export class Scale3d {
  constructor(data) {
    this.data = data;
    this.largest = data.largest;
    this.span = WIDTH_SPAN * (data.width_tolerance || 10); // [%]
    this.byWidth = Boolean(data.width) && data.blamed !== "path";
    this.bar = element("span", { class: "ramp" });
    this.low = element("span");
    this.high = element("span");
    this.element = element("span", { class: "scale" }, this.low, this.bar, this.high);
    this._legend();
    onTheme(() => this._legend());
  }

  get quantity() {
    return this.byWidth ? "the deviation of its width" : "the error of its path";
  }

  /** Buttons that choose the quantity; none where the bead's width is unknown. */
  buttons(changed) {
    if (!this.data.width) return [];
    return [
      choose("Colour", [["width", true], ["path error", false]], this.byWidth, (byWidth) => {
        this.byWidth = byWidth;
        this._legend();
        changed();
      }),
    ];
  }

  _legend() {
    const { data, byWidth, span, largest, bar } = this;
    this.low.textContent = byWidth ? `−${span} %` : "0";
    this.high.textContent = byWidth ? `+${span} %` : `${digits(largest)} µm`;
    bar.style.background = `linear-gradient(to right, ${(byWidth ? theme().widths : theme().errors).join(",")})`;
    const limit = byWidth ? data.width_tolerance : data.path_tolerance;
    const unit = byWidth ? "%" : "µm";
    const marks = byWidth ? [0.5 - limit / span / 2, 0.5 + limit / span / 2] : [limit / largest];
    bar.replaceChildren();
    for (const share of limit ? marks : []) {
      if (share > 1) continue;
      const mark = element("i", { title: `tolerance: ${digits(limit)} ${unit}` });
      mark.style.left = `${100 * share}%`;
      bar.append(mark);
    }
  }

  /** A function from a row to [red, green, blue]. */
  painter() {
    const { data, byWidth, span, largest } = this;
    const colours = theme();
    const ramp = table(byWidth ? colours.widths : colours.errors);
    const unknown = table([colours.soft, colours.soft])[0];
    const { width } = data.column;
    return (row) => {
      const share = byWidth ? 0.5 + (50 * (width[row] / data.width - 1)) / span : data.size[row] / largest;
      return share === share ? ramp[Math.round(LEVELS * Math.min(Math.max(share, 0), 1))] : unknown;
    };
  }
}
