// The place of the 3-D view of the bead: its script is expanded when the view comes into sight.

import { expanded } from "./data.js";
import { element } from "./dom.js";

const AHEAD = "200px"; // of the window's edge, at which the script is expanded
const NO_WEBGL = "No 3-D view: this browser draws no WebGL here. The plan shows the same bead from above.";
const NO_EXPANSION = "No 3-D view: this browser is too old to expand its script. The plan shows the same bead from above.";

function hasWebgl() {
  const context = document.createElement("canvas").getContext("webgl2");
  context?.getExtension("WEBGL_lose_context")?.loseContext(); // browsers allow few at a time
  return Boolean(context);
}

/** The class of the view, from the script that the page holds. */
async function viewOfPage() {
  const code = await expanded(document.getElementById("viewer-3d").textContent);
  return new Function(`${code}; return gantrysimSpace;`)().View;
}

export class Space {
  /** @param load returns a promise of the class of the view @param {RunData} data @param {Cursor} cursor */
  constructor(data, cursor, load = viewOfPage) {
    this.element = element("figure", { class: "view space" }, element("figcaption", {}, element("b", {}, "Bead in 3-D")));
    const reason = !hasWebgl() ? NO_WEBGL : typeof DecompressionStream === "undefined" ? NO_EXPANSION : "";
    if (reason) {
      this.element.append(element("p", { class: "reason", role: "status" }, reason));
      return;
    }
    this.element.append(element("div", { class: "surface", "aria-busy": "true" }));
    this.observer = new IntersectionObserver(
      (entries) => {
        if (!entries.some((entry) => entry.isIntersecting)) return;
        this.observer.disconnect();
        this._show(load, data, cursor);
      },
      { rootMargin: AHEAD },
    );
    this.observer.observe(this.element);
  }

  /** Give up what the view holds of the browser. */
  remove() {
    this.removed = true; // its script may still be on the way
    this.observer?.disconnect();
    this.view?.remove();
  }

  /** Show other data of the run. */
  update() {
    this.view?.update();
  }

  /** @param {RunData} data @param {Cursor} cursor @param {() => Promise<typeof import("./view3d.js").View>} load */
  async _show(load, data, cursor) {
    const View = await load();
    if (this.removed) return;
    this.view = new View(data, cursor);
    this.element.replaceChildren(...this.view.children);
    performance.mark("viewer-3d-ready");
  }
}
