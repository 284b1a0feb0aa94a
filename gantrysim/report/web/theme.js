// Colours of the page, light or dark, as its style sheet has them.

const DARK = window.matchMedia("(prefers-color-scheme: dark)");
const FORCED = window.matchMedia("(forced-colors: active)");

/**
 * Stops of a colour scale, [value, place, [red, green, blue]], ascending; gantrysim/results/colours.py has them.
 *
 * @param {CSSStyleDeclaration} style
 * @param {string} name
 * @returns {Stop[]}
 */
function stopsOf(style, name) {
  return style.getPropertyValue(name).split(",").map((stop) => {
    const [value, place, colour] = stop.trim().split(" ");
    return [Number(value), Number(place), [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16))];
  });
}

/** Last value of a scale. @param {Stop[]} stops */
export function endOf(stops) {
  return stops[stops.length - 1][0];
}

/** Place of a value on a scale, 0 to 1. @param {Stop[]} stops @param {number} value */
export function placeOn(stops, value) {
  const k = stops.findIndex((stop) => stop[0] > value);
  if (k === 0) return 0;
  if (k < 0) return 1;
  const [[low, first], [high, last]] = [stops[k - 1], stops[k]];
  return first + ((last - first) * (value - low)) / (high - low);
}

/** @param {() => void} listener */
export function onTheme(listener) {
  for (const query of [DARK, FORCED]) query.addEventListener("change", listener);
}

/** @type {Theme | null} */
let known = null;

// before any listener of `onTheme`
onTheme(() => {
  known = null;
});

/** The colours as they are now; read once, as that makes the browser compute the styles of the whole page. */
export function theme() {
  known ??= readTheme();
  return known;
}

/** @returns {Theme} */
function readTheme() {
  const style = getComputedStyle(document.documentElement);
  // forced colours are names of the system's, which WebGL does not know
  const probe = document.body;
  /** @param {string} name */
  const value = (name) => {
    const given = style.getPropertyValue(name).trim();
    if (!FORCED.matches) return given;
    probe.style.color = given;
    const colour = getComputedStyle(probe).color;
    probe.style.color = "";
    const parts = (colour.match(/\d+/g) ?? []).slice(0, 3).map(Number);
    return `#${parts.map((part) => part.toString(16).padStart(2, "0")).join("")}`;
  };
  return {
    ink: value("--ink"),
    soft: value("--soft"),
    line: value("--line"),
    paper: value("--paper"),
    alarm: value("--alarm"),
    near: value("--near"),
    shares: stopsOf(style, "--share-stops"),
    widths: stopsOf(style, "--width-stops"),
  };
}

/**
 * The colour of a series; the contour error has that of the text.
 *
 * @param {{ colour?: string | null, name?: string }} series
 * @param {Theme} colours
 */
export function colourOf(series, colours) {
  return !series.colour || series.name === "contour" ? colours.ink : series.colour;
}

/** The colour at a place of a scale, 0 to 1. @param {Stop[]} stops @param {number} place */
export function colourAt(stops, place) {
  const k = stops.findIndex((stop) => stop[1] > place);
  const [, first, low] = stops[k < 0 ? stops.length - 1 : Math.max(k - 1, 0)];
  const [, last, high] = stops[k < 0 ? stops.length - 1 : k];
  const share = last > first ? Math.max(place - first, 0) / (last - first) : 0;
  return `rgb(${low.map((part, i) => Math.round(part + share * (high[i] - part))).join(",")})`;
}
