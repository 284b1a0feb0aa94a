// The place of the 3-D view of the bead: its script is expanded when the view comes into sight.

import { expanded } from "./data.js";
import { element, within } from "./dom.js";

const AHEAD = "200px"; // of the window's edge, at which the script is expanded
const NO_WEBGL = "No 3-D view: this browser draws no WebGL here. The plan shows the same bead from above.";
const NO_EXPANSION = "No 3-D view: this browser is too old to expand its script. The plan shows the same bead from above.";

function hasWebgl() {
  const context = document.createElement("canvas").getContext("webgl2");
  context?.getExtension("WEBGL_lose_context")?.loseContext(); // browsers allow few at a time
  return Boolean(context);
}

/** A view, by the script that the page holds. @param {RunData} data @param {Cursor} cursor @returns {Promise<SpaceView>} */
export async function viewOfPage(data, cursor) {
  const code = await expanded(within(document, "#viewer-3d").textContent ?? "");
  const { View } = new Function(`${code}; return gantrysimSpace;`)();
  return new View(data, cursor);
}

export class Space {
  /** @param {() => Promise<SpaceView>} load makes the view */
  constructor(load) {
    this.element = element("figure", { class: "view space" }, element("figcaption", {}, element("b", {}, "Bead in 3-D")));
    const reason = !hasWebgl() ? NO_WEBGL : typeof DecompressionStream === "undefined" ? NO_EXPANSION : "";
    if (reason) {
      this.element.append(element("p", { class: "reason", role: "status" }, reason));
      return;
    }
    this.element.append(element("div", { class: "surface", "aria-busy": "true" }));
    const observer = new IntersectionObserver(
      (entries) => {
        if (!entries.some((entry) => entry.isIntersecting)) return;
        observer.disconnect();
        this._show(load);
      },
      { rootMargin: AHEAD },
    );
    observer.observe(this.element);
    this.observer = observer;
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

  /** @param {() => Promise<SpaceView>} load */
  async _show(load) {
    const view = await load();
    if (this.removed) view.remove();
    if (this.removed) return;
    this.view = view;
    this.element.replaceChildren(...this.view.children);
    performance.mark("viewer-3d-ready");
  }
}
