// The verdict's four rows, and the proposals of what to change.

import { element } from "../../report/web/dom.js";

/**
 * Show a verdict in a place, that of the kept run beside it; what was unfolded stays so.
 *
 * @param {HTMLElement} place @param {Head} head
 */
export function showVerdict(place, head) {
  const words = JSON.stringify([head.headline, head.rows, head.sentence, head.kept]);
  if (place.dataset.words === words) return; // else it would be read out again
  place.dataset.words = words;
  const open = [...place.querySelectorAll("[data-row]:has(details[open])")].map((row) => row.getAttribute("data-row"));
  place.replaceChildren(...verdictRows(head));
  for (const name of open) place.querySelector(`[data-row="${name}"] details`)?.setAttribute("open", "");
}

/** @param {Head} head */
function verdictRows(head) {
  const kept = head.kept ? new Map(head.kept.rows.map((row) => [row.name, row])) : null;
  const rows = head.rows.map((row) => verdictRow(row, kept?.get(row.name)));
  const title = element("p", { class: `state ${stateClass(head.state)}` }, head.headline);
  const sentence = head.sentence ? [element("p", { class: "sentence" }, head.sentence)] : [];
  return [title, ...rows, ...sentence];
}

/** @param {RowContent} row @param {RowContent} [kept] of the kept run */
export function verdictRow(row, kept) {
  const [first, ...others] = row.texts.map((text) => element("p", {}, text));
  /** @type {HTMLElement[]} */
  const texts = first ? [first] : [];
  if (others.length) texts.push(element("details", {}, element("summary", {}, `${others.length} more`), ...others));
  const before = kept ? [element("p", { class: "before" }, `kept: ${kept.symbol} ${kept.texts[0] || ""}`)] : [];
  const head = element("h3", {}, element("span", { class: "symbol", "aria-hidden": "true" }, row.symbol), ` ${row.name}: ${row.state}`);
  return element("div", { class: `row ${stateClass(row.state)}`, "data-row": row.name }, head, ...texts, ...before);
}

/** @param {string} state */
function stateClass(state) {
  return `is-${state.replaceAll(" ", "-")}`;
}

/**
 * The proposals, each with the share of the limits that it leaves used, and a button to try it.
 *
 * @param {Proposals} found @param {(number: number) => void} tried
 */
export function proposalTable({ sentence, heads, proposals }, tried) {
  const head = ["", ...heads, ""].map((text) => element("th", { scope: "col" }, text));
  const rows = proposals.map(({ label, usages, cost }, number) => {
    const button = element("button", { type: "button", "data-proposal": number, "aria-label": `try ${label}` }, "try");
    button.addEventListener("click", () => tried(number));
    const name = element("th", { scope: "row", title: cost }, label);
    return element("tr", {}, name, ...usages.map((usage) => element("td", {}, usage)), element("td", {}, button));
  });
  const table = element("table", {}, element("thead", {}, element("tr", {}, ...head)), element("tbody", {}, ...rows));
  const note = element("p", { class: "note" }, "worst value of each row in % of its limit");
  return [element("p", { class: "sentence" }, sentence), ...(rows.length ? [note, element("div", { class: "wide" }, table)] : [])];
}
