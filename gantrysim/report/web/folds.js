// Details of the page: open where scripts do not run, else folded until they are asked for; what is open is printed.

/** Fold all details; open the one that an address names. */
export function fold() {
  const reveal = () => {
    const target = location.hash && document.getElementById(location.hash.slice(1));
    const details = target && (target.closest("details") || target.querySelector(":scope > details"));
    if (details) details.open = true;
  };
  for (const details of /** @type {NodeListOf<HTMLDetailsElement>} */ (document.querySelectorAll("section > details"))) details.open = false;
  reveal();
  window.addEventListener("hashchange", reveal);
  for (const link of document.querySelectorAll("nav a")) link.addEventListener("click", () => setTimeout(reveal));
}

/** Let tables and figures that are wider than their place say that they scroll. */
export function markScrolling() {
  const observer = new ResizeObserver((entries) => {
    for (const { target } of entries) target.classList.toggle("scrolls", target.scrollWidth > target.clientWidth + 1);
  });
  for (const table of document.querySelectorAll(".table, .figures > figure")) observer.observe(table);
}
