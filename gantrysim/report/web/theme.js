// Colours of the page, light or dark, as its style sheet has them.

const DARK = window.matchMedia("(prefers-color-scheme: dark)");

// lightness falls steadily on light paper and rises on dark, so that neither print nor colour vision matters
const LIGHT_RAMP = ["#b9cfe4", "#e0a64e", "#cc5a3a", "#7d124f"];
const DARK_RAMP = ["#41617f", "#a4588a", "#ee9a62", "#fff2ae"];
// thin, as requested, wide
const LIGHT_WIDTHS = ["#1f5fa8", "#b7b1a4", "#a8340c"];
const DARK_WIDTHS = ["#6aaef5", "#8f897c", "#ff9152"];
export const WIDTH_SPAN = 3; // deviation of the width at the ends of its scale, in tolerances

export function onTheme(listener) {
  DARK.addEventListener("change", listener);
}

export function theme() {
  const style = getComputedStyle(document.documentElement);
  const value = (name) => style.getPropertyValue(name).trim();
  return {
    ink: value("--ink"),
    soft: value("--soft"),
    line: value("--line"),
    paper: value("--paper"),
    alarm: value("--alarm"),
    errors: DARK.matches ? DARK_RAMP : LIGHT_RAMP,
    widths: DARK.matches ? DARK_WIDTHS : LIGHT_WIDTHS,
  };
}

/** The colour of a series; the contour error has that of the text. */
export function colourOf(series, colours) {
  return !series.colour || series.name === "contour" ? colours.ink : series.colour;
}

/** The colour at a share, 0 to 1, of a ramp of colours. */
export function mixed(ramp, share) {
  const place = Math.min(Math.max(share, 0), 1) * (ramp.length - 1);
  const k = Math.min(Math.floor(place), ramp.length - 2);
  const part = (colour, i) => parseInt(colour.slice(2 * i + 1, 2 * i + 3), 16);
  const mix = [0, 1, 2].map((i) => {
    const low = part(ramp[k], i);
    return Math.round(low + (place - k) * (part(ramp[k + 1], i) - low));
  });
  return `rgb(${mix.join(",")})`;
}
