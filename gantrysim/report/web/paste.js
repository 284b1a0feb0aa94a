// The button that copies the lines to paste.

import { within } from "./dom.js";

const SHOWN = 1500; // for which it says that it has copied [ms]

export function copyButtons() {
  for (const button of document.querySelectorAll("button.copy")) {
    const code = button.parentElement && within(button.parentElement, "code");
    if (!code) continue;
    const label = button.textContent;
    button.addEventListener("click", async () => {
      const done = await copied(code);
      button.textContent = done ? "copied" : "selected: Ctrl+C copies";
      setTimeout(() => {
        button.textContent = label;
      }, SHOWN);
    });
  }
}

/** Copy an element's text, and leave it selected where the browser does not allow that. @param {HTMLElement} code */
async function copied(code) {
  try {
    await navigator.clipboard.writeText(code.textContent ?? "");
    return true;
  } catch {
    const range = document.createRange();
    range.selectNodeContents(code);
    const selection = window.getSelection();
    selection?.removeAllRanges();
    selection?.addRange(range);
    return document.execCommand("copy"); // pages without a secure origin have nothing else
  }
}
