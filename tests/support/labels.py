"""Faults of a page's labels in a browser: texts that are cut, leave their picture, or run into one another."""

from contextlib import contextmanager

# texts on canvases leave no element: noted as they are drawn, until their canvas is cleared
NOTES = """
const prototype = CanvasRenderingContext2D.prototype;
const { fillText, clearRect } = prototype;
prototype.fillText = function (text, x, y, ...rest) {
  const m = this.measureText(text);
  const matrix = this.getTransform();
  const sides = [-m.actualBoundingBoxLeft, m.actualBoundingBoxRight];
  const heights = [-m.actualBoundingBoxAscent, m.actualBoundingBoxDescent];
  const points = sides.flatMap((dx) => heights.map((dy) => matrix.transformPoint({ x: x + dx, y: y + dy })));
  const [xs, ys] = [points.map((p) => p.x), points.map((p) => p.y)];
  const box = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
  const size = parseFloat(this.font.match(/[\\d.]+px/));
  if (String(text).trim()) (this.canvas.noted ||= []).push({ text: String(text), box, size });
  return fillText.call(this, text, x, y, ...rest);
};
prototype.clearRect = function (...box) {
  this.canvas.noted = [];
  return clearRect.call(this, ...box);
};
"""

FAULTS = """
const [least] = arguments;
const labels = [];
const faults = [];
const shown = (element) => element.checkVisibility({ opacityProperty: true, visibilityProperty: true });
const classOf = (element) => element.closest("[class]")?.getAttribute("class") || "";
const named = (element) => `${element.closest("section")?.id || "page"} ${classOf(element)}`;
// the part of a box that its ancestors show; what hides is a fault, what scrolls is not
const visible = (element, box, text) => {
  let [left, top, right, bottom] = box;
  for (let outer = element; outer && outer !== document.body; outer = outer.parentElement) {
    const style = getComputedStyle(outer);
    if (style.overflowX === "visible" && style.overflowY === "visible") continue;
    const b = outer.getBoundingClientRect();
    const cut = left < b.left - 1 || right > b.right + 1 || top < b.top - 2 || bottom > b.bottom + 2;
    if (cut && style.overflowX === "hidden" && outer.tagName !== "svg" && outer.clientWidth > 1) {
      faults.push(`cut: ${text} in ${named(element)}`);
    }
    [left, top] = [Math.max(left, b.left), Math.max(top, b.top)];
    [right, bottom] = [Math.min(right, b.right), Math.min(bottom, b.bottom)];
  }
  return [left, top, right, bottom];
};
const note = (element, text, box, size) => {
  const [left, top, right, bottom] = visible(element, box, text);
  if (right - left < 2 || bottom - top < 2) return;
  // letters are lower than their line
  const inset = 0.22 * (bottom - top);
  labels.push({ text, box: [left + 1, top + inset, right - 1, bottom - inset], element });
  if (size < least - 0.05) faults.push(`${size.toFixed(1)} px: ${text} in ${named(element)}`);
};
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
for (let node = walker.nextNode(); node; node = walker.nextNode()) {
  const element = node.parentElement;
  if (!node.data.trim() || element.closest("script, style, video, title") || !shown(element)) continue;
  const range = document.createRange();
  range.selectNodeContents(node);
  const svg = element.closest("svg");
  const scale = svg ? svg.getBoundingClientRect().width / svg.viewBox.baseVal.width : 1;
  const size = scale * parseFloat(getComputedStyle(element).fontSize);
  for (const b of range.getClientRects()) {
    if (b.width < 2 || b.height < 2) continue;
    const frame = svg?.getBoundingClientRect();
    const aside = frame && (b.left < frame.left - 1 || b.right > frame.right + 1);
    if (aside || (frame && (b.top < frame.top - 2 || b.bottom > frame.bottom + 2))) {
      faults.push(`leaves its figure: ${node.data.trim()} in ${named(svg.closest("figure"))}`);
    }
    note(element, node.data.trim(), [b.left, b.top, b.right, b.bottom], size);
  }
}
for (const canvas of document.querySelectorAll("canvas")) {
  if (!shown(canvas)) continue;
  const b = canvas.getBoundingClientRect();
  const ratio = canvas.width / b.width;
  for (const { text, box, size } of canvas.noted || []) {
    const [left, top, right, bottom] = box.map((value) => value / ratio);
    if (left < -1 || top < -1 || right > b.width + 1 || bottom > b.height + 1) {
      faults.push(`leaves its picture: ${text} in ${named(canvas)}`);
    }
    note(canvas, text, [left + b.left, top + b.top, right + b.left, bottom + b.top], size / ratio);
  }
}
const sticky = (element) => element.closest(".readout, .copy");
labels.forEach((one, k) => {
  for (const other of labels.slice(k + 1)) {
    const [a, b] = [one.box, other.box];
    const wide = Math.min(a[2], b[2]) - Math.max(a[0], b[0]);
    const high = Math.min(a[3], b[3]) - Math.max(a[1], b[1]);
    // what stays in sight while the page scrolls lies over it
    if (wide > 0 && high > 0 && sticky(one.element) === sticky(other.element)) {
      faults.push(`over one another: ${one.text} | ${other.text} in ${named(one.element)}`);
    }
  }
});
return faults;
"""


def label_faults(page, least=0.0):
    """The faults of all labels of an open page, those smaller than a size [pixels] among them."""
    page.run("for (const details of document.querySelectorAll('details')) details.open = true")
    # the 3-D view is expanded and drawn where it is seen
    page.run("document.querySelector('.stage, .viewer')?.scrollIntoView({behavior: 'instant'})")
    if page.run("return document.getElementById('viewer-3d') !== null"):
        page.wait("performance.getEntriesByName('viewer-3d-ready').length > 0", 20.0)
    page.settle()
    page.settle()
    return page.run(FAULTS, least)


@contextmanager
def noting_texts(browser):
    """Note the texts that are drawn on canvases of the pages that are opened meanwhile."""
    script = browser.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": NOTES})
    try:
        yield
    finally:
        browser.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)
