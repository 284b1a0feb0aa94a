// Details of the page: open in print and where scripts do not run, else folded until they are asked for.

/** Fold all details; open them for print, and the one that an address names. */
export function fold() {
  const all = [...document.querySelectorAll("section > details")];
  const reveal = () => {
    const target = location.hash && document.getElementById(location.hash.slice(1));
    const details = target && (target.closest("details") || target.querySelector(":scope > details"));
    if (details) details.open = true;
  };
  for (const details of all) details.open = false;
  reveal();
  window.addEventListener("hashchange", reveal);
  for (const link of document.querySelectorAll("nav a")) link.addEventListener("click", () => setTimeout(reveal));
  let folded = [];
  window.addEventListener("beforeprint", () => {
    folded = all.filter((details) => !details.open);
    for (const details of folded) details.open = true;
  });
  window.addEventListener("afterprint", () => {
    for (const details of folded) details.open = false;
  });
}
