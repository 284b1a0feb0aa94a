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

export class Space {
  constructor(data, cursor) {
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
        this._load(data, cursor);
      },
      { rootMargin: AHEAD },
    );
    observer.observe(this.element);
  }

  async _load(data, cursor) {
    const code = await expanded(document.getElementById("viewer-3d").textContent);
    const { View } = new Function(`${code}; return gantrysimSpace;`)();
    this.element.replaceChildren(...new View(data, cursor).children);
    performance.mark("viewer-3d-ready");
  }
}
