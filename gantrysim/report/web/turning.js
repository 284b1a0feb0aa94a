// Gestures of a view that turns: drag turns, Shift-drag or the right button moves, wheel and two fingers zoom; keys.

const CLICK = 4; // pixels within which a press is a click
const WHEEL = 0.0015; // of the logarithm of the zoom, a unit of the wheel
const DEGREES = 0.4; // a pixel of a drag
const STEP = 10; // of a key [deg]
const SHIFT = 40; // of a key [pixels]
const NEARER = 1.25; // of a key

/** @type {Record<string, number[]>} */
const DIRECTIONS = { a: [-1, 0], d: [1, 0], w: [0, 1], s: [0, -1] };

/**
 * Call the handlers of a view, places in pixels from its corner: hover(x, y), click(x, y), turn(azimuth, elevation) in
 * degrees, pan(dx, dy), zoom(factor, x, y), without a place about the middle, and reset(). The wheel zooms in a view that
 * has the focus, or with Ctrl: else nobody could scroll past it.
 *
 * @param {HTMLElement} surface @param {Turns} handlers
 */
export function turning(surface, handlers) {
  const pressed = new Map(); // pointers by their number
  let moved = false;
  let from = [0, 0];
  let panning = false;
  /** @type {(event: MouseEvent) => [number, number]} */
  const place = (event) => {
    const box = surface.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const span = () => {
    const [[x0, y0], [x1, y1]] = pressed.values();
    return { size: Math.max(Math.hypot(x1 - x0, y1 - y0), 1), x: (x0 + x1) / 2, y: (y0 + y1) / 2 };
  };
  surface.addEventListener("pointerdown", (event) => {
    if (!pressed.size) {
      moved = false;
      from = place(event);
    }
    panning = event.shiftKey || event.button > 0;
    pressed.set(event.pointerId, place(event));
    if (event.pointerType !== "touch") surface.setPointerCapture(event.pointerId);
    if (event.shiftKey || event.button === 1) event.preventDefault();
  });
  surface.addEventListener("pointermove", (event) => {
    const [x, y] = place(event);
    const last = pressed.get(event.pointerId);
    if (!last) {
      handlers.hover(x, y);
      return;
    }
    moved = moved || Math.hypot(x - from[0], y - from[1]) > CLICK;
    if (!moved) return;
    const before = pressed.size === 2 ? span() : null;
    pressed.set(event.pointerId, [x, y]);
    if (before) {
      const after = span();
      handlers.pan(after.x - before.x, after.y - before.y);
      handlers.zoom(after.size / before.size, after.x, after.y);
    } else if (panning) handlers.pan(x - last[0], y - last[1]);
    else {
      const scrolls = event.pointerType === "touch" && document.activeElement !== surface; // upwards the page does
      handlers.turn(DEGREES * (x - last[0]), scrolls ? 0 : DEGREES * (y - last[1]));
    }
  });
  surface.addEventListener("pointerup", (event) => {
    const single = pressed.size === 1;
    if (!pressed.delete(event.pointerId) || moved || !single || event.button) return;
    surface.focus({ preventScroll: true });
    handlers.click(...place(event));
  });
  surface.addEventListener("pointercancel", (event) => pressed.delete(event.pointerId));
  surface.addEventListener("contextmenu", (event) => event.preventDefault());
  surface.addEventListener("dblclick", () => handlers.reset());
  /** @param {WheelEvent} event */
  const wheel = (event) => {
    if (document.activeElement !== surface && !event.ctrlKey) return;
    event.preventDefault();
    handlers.zoom(Math.exp(-WHEEL * event.deltaY), ...place(event));
  };
  surface.addEventListener("wheel", wheel, { passive: false });
  surface.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.toLowerCase();
    if (key in DIRECTIONS) {
      const [right, up] = DIRECTIONS[key];
      if (event.shiftKey) handlers.pan(-SHIFT * right, SHIFT * up);
      else handlers.turn(STEP * right, STEP * up);
    } else if (key === "+" || key === "=") handlers.zoom(NEARER);
    else if (key === "-") handlers.zoom(1 / NEARER);
    else if (key === "0") handlers.reset();
    else return;
    event.preventDefault();
  });
}
