// Gestures on a view: hover, click, zoom by wheel and drag, pan by shift-drag, double click.

const CLICK = 4; // pixels within which a press is a click
const WHEEL = 0.0015; // of the logarithm of the zoom, a unit of the wheel

/**
 * Call the handlers of a view, places in pixels from its corner.
 *
 * hover(x, y); click(x, y); zoom(factor, x, y); pan(dx, dy); box(x0, y0, x1, y1) at the end of a drag, dragging(...) on
 * its way and without arguments when it is over; reset(). The wheel zooms in a view that has the focus, or with Ctrl: else
 * nobody could scroll past it.
 *
 * @param {HTMLElement} surface @param {HTMLElement} focus @param {Gestures} handlers
 */
export function gestures(surface, focus, handlers) {
  /** @type {{ x: number, y: number, last: number[], pan: boolean, moved: boolean, touch: boolean } | null} */
  let press = null;
  /** @type {(event: MouseEvent) => [number, number]} */
  const place = (event) => {
    const box = surface.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  surface.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    const [x, y] = place(event);
    press = { x, y, last: [x, y], pan: event.shiftKey, moved: false, touch: event.pointerType === "touch" };
    if (!press.touch) surface.setPointerCapture(event.pointerId);
    if (event.shiftKey) event.preventDefault();
  });
  surface.addEventListener("pointermove", (event) => {
    const [x, y] = place(event);
    if (!press) {
      handlers.hover(x, y);
      return;
    }
    press.moved = press.moved || Math.hypot(x - press.x, y - press.y) > CLICK;
    if (press.touch || !press.moved) return;
    if (press.pan) handlers.pan(x - press.last[0], y - press.last[1]);
    else handlers.dragging(press.x, press.y, x, y);
    press.last = [x, y];
  });
  /** @param {MouseEvent} event @param {boolean} whole */
  const ended = (event, whole) => {
    if (!press) return;
    const [x, y] = place(event);
    const { moved, pan, touch } = press;
    /** @type {[number, number]} */
    const from = [press.x, press.y];
    press = null;
    handlers.dragging();
    if (!whole) return;
    if (!moved) {
      focus.focus({ preventScroll: true });
      handlers.click(x, y);
    } else if (!pan && !touch) handlers.box(...from, x, y);
  };
  surface.addEventListener("pointerup", (event) => ended(event, true));
  surface.addEventListener("pointercancel", (event) => ended(event, false));
  surface.addEventListener("dblclick", () => handlers.reset());
  surface.addEventListener(
    "wheel",
    (event) => {
      if (document.activeElement !== focus && !event.ctrlKey) return;
      event.preventDefault();
      handlers.zoom(Math.exp(-WHEEL * event.deltaY), ...place(event));
    },
    { passive: false },
  );
}
