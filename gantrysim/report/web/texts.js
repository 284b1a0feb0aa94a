// Texts on a canvas that neither leave it nor run into one another: those written first stay.

const EDGE = 2; // clear of the picture's edge [pixels]
const APART = 3; // between two texts

export class Texts {
  /** @param {Context} context @param {number} width @param {number} height */
  constructor(context, width, height) {
    this.context = context;
    this.width = width;
    this.height = height;
    /** @type {number[][]} */
    this.boxes = [];
  }

  /**
   * Keep a place free of the texts that follow, [left, top, right, bottom].
   * @param {number[]} box
   */
  keep(box) {
    this.boxes.push(box);
  }

  /**
   * Write a text at the first of some places where there is room, [x, y, align], y in its middle; returns whether there
   * is any. With `always`, it stands at the first place, moved into the picture.
   *
   * @param {string} text @param {TextPlace[]} places @param {TextLooks} looks
   */
  write(text, places, { always = false, halo, ...looks } = {}) {
    const { context } = this;
    Object.assign(context, { textBaseline: "middle", ...looks });
    const measured = context.measureText(text);
    const high = (parseFloat(context.font.match(/[\d.]+px/)?.[0] ?? "") || 11) * 1.2;
    /** @param {TextPlace} place */
    const boxAt = ([x, y, align]) => {
      const left = align === "right" ? x - measured.width : align === "center" ? x - measured.width / 2 : x;
      return [left, y - high / 2, left + measured.width, y + high / 2];
    };
    /** @param {number[]} box */
    const inside = ([left, top, right, bottom]) =>
      left >= EDGE && top >= EDGE && right <= this.width - EDGE && bottom <= this.height - EDGE;
    /** @param {number[]} box */
    const clear = (box) =>
      this.boxes.every(
        (other) =>
          box[0] > other[2] + APART || box[2] < other[0] - APART || box[1] > other[3] || box[3] < other[1],
      );
    let box = places.map(boxAt).find((one) => inside(one) && clear(one));
    if (!box && always) {
      box = boxAt(places[0]);
      const dx = Math.max(EDGE - box[0], 0) + Math.min(this.width - EDGE - box[2], 0);
      const dy = Math.max(EDGE - box[1], 0) + Math.min(this.height - EDGE - box[3], 0);
      box = [box[0] + dx, box[1] + dy, box[2] + dx, box[3] + dy];
      if (!clear(box)) box = undefined;
    }
    if (!box) return false;
    this.boxes.push(box);
    context.textAlign = "left";
    if (halo) {
      Object.assign(context, { strokeStyle: halo, lineWidth: 3, lineJoin: "round" });
      context.strokeText(text, box[0], (box[1] + box[3]) / 2);
    }
    context.fillText(text, box[0], (box[1] + box[3]) / 2);
    return true;
  }
}

/**
 * Places around a point for its label: right, left, above, below.
 *
 * @param {number} x @param {number} y @param {number} away @returns {TextPlace[]}
 */
export function around(x, y, away) {
  return [
    [x + away, y + away, "left"],
    [x - away, y + away, "right"],
    [x + away, y - away, "left"],
    [x - away, y - away, "right"],
    [x, y - 2 * away, "center"],
    [x, y + 2 * away, "center"],
  ];
}
