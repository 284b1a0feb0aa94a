// The viewer of a run's page: film, bead, plan, strips and program with one cursor.

import { BeadMap } from "./beadmap.js";
import { Cursor } from "./cursor.js";
import { RunData, extent } from "./data.js";
import { element } from "./dom.js";
import { FilmLink } from "./film.js";
import { fold } from "./folds.js";
import { Listing } from "./listing.js";
import { Region } from "./map.js";
import { Plan } from "./plan.js";
import { Readout } from "./readout.js";
import { Strips } from "./strips.js";

const HINT =
  "Hover moves the cursor, a click pins it, ← → step (with Shift 50 samples), Home and End. Drag or wheel zooms, " +
  "Shift-drag pans, a double click shows everything. The wheel zooms in the view that was clicked last.";

function regionOf(data) {
  const [x0, x1] = extent(data.column.x);
  const [y0, y1] = extent(data.column.y);
  const margin = Math.max(0.02 * Math.max(x1 - x0, y1 - y0), data.width || 0, 1e-3);
  return new Region({ x0: x0 - margin, x1: x1 + margin, y0: y0 - margin, y1: y1 + margin });
}

function start() {
  const place = document.querySelector(".viewer");
  const data = new RunData(JSON.parse(document.getElementById("viewer-data").textContent));
  const cursor = new Cursor(data.rows, data.worst);
  const region = regionOf(data);
  document.documentElement.classList.add("live");
  const strips = new Strips(data, cursor);
  const readout = new Readout(data, cursor, (name, shown) => strips.setShown(name, shown));
  const views = element("div", { class: "views" });
  const video = place.parentElement.querySelector("video");
  if (video) {
    const caption = element("figcaption", {}, element("b", {}, "Film"));
    views.append(element("figure", { class: "view film" }, caption, video));
    new FilmLink(video, data, cursor);
  }
  if (data.width) views.append(new BeadMap(data, cursor, region).element);
  views.append(new Plan(data, cursor, region).element);
  if (data.program) views.append(new Listing(data, cursor).element);
  place.append(readout.element, views, strips.element, element("p", { class: "hint" }, HINT));
  cursor.set(data.worst, "start");
  fold();
}

start();
performance.mark("viewer-ready");
