// Elements of the page in a line each.

/**
 * Return a new element with attributes, and children that are elements or text.
 *
 * @template {keyof HTMLElementTagNameMap} Tag
 * @param {Tag} tag
 * @param {Attributes} attributes
 * @param {(Node | string)[]} children
 * @returns {HTMLElementTagNameMap[Tag]}
 */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  made.append(...children);
  return made;
}

/**
 * The element of a selector that the page has for certain.
 *
 * @param {ParentNode} place
 * @param {string} selector
 * @returns {HTMLElement}
 */
export function within(place, selector) {
  const found = place.querySelector(selector);
  if (!(found instanceof HTMLElement)) throw new Error(`the page has no ${selector}`);
  return found;
}

/** The context of a canvas on which lines and texts are drawn. @param {HTMLCanvasElement} canvas */
export function contextOf(canvas) {
  const context = canvas.getContext("2d");
  if (!context) throw new Error("this browser draws on no canvas");
  return context;
}

/**
 * Return a button that is on or off, and calls a function with its new state.
 *
 * @param {string} label
 * @param {boolean} pressed
 * @param {(on: boolean) => void} changed
 * @param {Attributes} attributes
 */
export function toggle(label, pressed, changed, attributes = {}) {
  const button = element("button", { type: "button", "aria-pressed": String(pressed), ...attributes }, label);
  button.addEventListener("click", () => {
    const next = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(next));
    changed(next);
  });
  return button;
}

/**
 * A piece of a line as in the strips, for a legend.
 *
 * @param {string} colour
 * @param {number[]} [dash]
 */
export function sample(colour, dash = []) {
  const template = document.createElement("template");
  const stroke = `stroke="${colour}" stroke-width="3" stroke-dasharray="${dash.join(" ")}"`;
  template.innerHTML = `<svg class="sample" viewBox="0 0 30 8" aria-hidden="true"><line x2="30" y1="4" y2="4" ${stroke}/></svg>`;
  return template.content;
}

/**
 * Buttons of which one is pressed: [label, value] each; calls a function with the value that is chosen.
 *
 * @template Value
 * @param {string} name
 * @param {[string, Value][]} entries
 * @param {Value} value
 * @param {(value: Value) => void} changed
 */
export function choose(name, entries, value, changed) {
  const buttons = entries.map(([label, own]) => {
    const button = element("button", { type: "button", "aria-pressed": String(own === value) }, label);
    button.addEventListener("click", () => {
      for (const other of buttons) other.setAttribute("aria-pressed", String(other === button));
      changed(own);
    });
    return button;
  });
  return element("span", { class: "choice", role: "group", "aria-label": name }, ...buttons);
}
