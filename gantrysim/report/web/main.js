// The viewer of a page: of a run, with film, bead, path, strips and program on one cursor, or of several runs.

import { BeadMap } from "./beadmap.js";
import { showComparison } from "./comparison.js";
import { Cursor } from "./cursor.js";
import { RunData, expanded } from "./data.js";
import { element, within } from "./dom.js";
import { FilmLink } from "./film.js";
import { fold, markScrolling } from "./folds.js";
import { Links } from "./links.js";
import { Listing } from "./listing.js";
import { regionOf } from "./map.js";
import { Moment } from "./moment.js";
import { copyButtons } from "./paste.js";
import { Plan } from "./plan.js";
import { Readout } from "./readout.js";
import { Space, viewOfPage } from "./space.js";
import { Strips } from "./strips.js";

const HINT =
  "Hover moves the cursor, a click pins it, ← → step (with Shift 50 samples), Home and End. Drag or wheel zooms, " +
  "Shift-drag pans, a double click shows everything. The wheel zooms in the view that was clicked last.";

/** @param {HTMLElement} place @param {RunContent} content */
function showRun(place, content) {
  const data = new RunData(content);
  const cursor = new Cursor(data.rows, data.worst);
  const widest = data.dots.reduce((most, dot) => Math.max(most, 2 * dot.radius), data.width || 0);
  const region = regionOf([data.column.x, data.requested.x], [data.column.y, data.requested.y], widest);
  const strips = new Strips(data, cursor);
  const readout = new Readout(data, cursor, (name, shown) => strips.setShown(name, shown));
  const views = element("div", { class: "views" });
  const video = place.parentElement?.querySelector("video");
  if (video) {
    const caption = element("figcaption", {}, element("b", {}, "Film"));
    views.append(element("figure", { class: "view film" }, caption, video));
    new FilmLink(video, data, cursor);
  }
  // the first of these is on the page's first screen
  const pictures = [];
  if (data.space) pictures.push(new Space(() => viewOfPage(data, cursor)).element);
  if (data.width || data.dots.length) pictures.push(new BeadMap(data, cursor, region).element);
  pictures.push(new Plan(data, cursor, region).element);
  const stage = document.querySelector(".stage");
  const [first, ...others] = pictures;
  if (stage) stage.append(first, new Moment(data, cursor).element);
  views.append(...(stage ? others : pictures));
  if (data.program) views.append(new Listing(data, cursor).element);
  place.append(readout.element, views, strips.element);
  const shown = stage || place;
  new Links(data, cursor, () => shown.scrollIntoView({ block: "nearest" }));
  return cursor;
}

/** Where a browser is too old to expand its data, the page stays as it is without scripts. */
async function start() {
  const place = within(document, ".viewer");
  const content = JSON.parse(await expanded(within(document, "#viewer-data").textContent ?? ""));
  document.documentElement.classList.add("live");
  const cursor = content.runs ? showComparison(place, content) : showRun(place, content);
  place.append(element("p", { class: "hint" }, HINT));
  cursor.set(cursor.row, "start");
  copyButtons();
  fold();
  markScrolling();
  performance.mark("viewer-ready");
}

start();
