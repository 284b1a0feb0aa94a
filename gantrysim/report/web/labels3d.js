// What is written over the 3-D view: labels of the grid and of the heights, the axes, the ends, and the cursor.

import { number, stretches } from "./data.js";
import { steps } from "./ground3d.js";
import { around, Texts } from "./texts.js";

const ARROW = 26; // length of an axis of the triad [pixels]
const CORNER = 44; // from the picture's corner to the triad [pixels]
const LABEL = 13; // from an edge to its label [pixels]
const CROWDED = 36; // distance below which a label would run into the one before [pixels]
const STEEP = 75; // elevation from which on heights cannot be read [deg]
const CLEAR = 0.4; // of the step of the heights, from the ground to their first label

/** @param {number} step */
const decimalsOf = (step) => Math.max(0, -Math.floor(Math.log10(step) + 1e-9));

export class Labels {
  /** @type {Context} */ context;
  /** @type {Theme} */ colours;
  /** @type {Texts} */ texts;

  /** @param {Scene3d<RunData> | Scene3d<ComparedData>} view */
  constructor(view) {
    this.view = view;
    this.place = [0, 0, 0];
  }

  /** @param {Context} context @param {Theme} colours */
  draw(context, colours) {
    const { width, height } = this.view;
    context.clearRect(0, 0, width, height);
    context.font = `11px ${getComputedStyle(document.body).fontFamily}`;
    this.context = context;
    this.colours = colours;
    this.texts = new Texts(context, width, height);
    this._marks();
    this._triad();
    this._heights();
    this._ground();
    this._cursor();
  }

  /** Place in the picture of a point of the work [mm]. @param {number} x @param {number} y @param {number} z */
  at(x, y, z) {
    return [...this.view.project(x, y, z, this.place)];
  }

  /**
   * Write a text at the first of some places where there is room, see `Texts`.
   *
   * @param {string} text @param {TextPlace[]} places @param {TextLooks} looks
   */
  _text(text, places, looks = {}) {
    const { colours } = this;
    this.texts.write(text, places, { fillStyle: colours.soft, halo: colours.paper, ...looks });
  }

  /** Numbers along the two edges of the grid that are nearest, and the heights at the corner farthest to the left. */
  _ground() {
    const { ground } = this.view;
    const decimals = decimalsOf(ground.step);
    /** @param {number} x @param {number} y */
    const depth = (x, y) => this.at(x, y, ground.z)[2];
    const [x0, x1] = ground.x;
    const [y0, y1] = ground.y;
    /** @type {[number, number]} */
    const middle = [(x0 + x1) / 2, (y0 + y1) / 2];
    const y = depth(middle[0], y0) < depth(middle[0], y1) ? y0 : y1;
    const x = depth(x0, middle[1]) < depth(x1, middle[1]) ? x0 : x1;
    const beyond = this.at(...middle, ground.z);
    /** @type {number[] | null} */
    let last = null;
    /** @param {string} text @param {number[]} place */
    const label = (text, place) => {
      if (place[2] <= 0 || (last && Math.hypot(place[0] - last[0], place[1] - last[1]) < CROWDED)) return;
      last = place;
      const away = Math.hypot(place[0] - beyond[0], place[1] - beyond[1]) || 1;
      const share = LABEL / away;
      const px = place[0] + share * (place[0] - beyond[0]);
      const py = place[1] + share * (place[1] - beyond[1]);
      this._text(text, [[px, py, "center"]]);
    };
    for (const value of steps(x0, x1, ground.step)) label(`x ${number(value, decimals)}`, this.at(value, y, ground.z));
    last = null;
    for (const value of steps(y0, y1, ground.step)) {
      if (value !== y) label(`y ${number(value, decimals)}`, this.at(x, value, ground.z));
    }
  }

  _heights() {
    const { context, colours } = this;
    const { ground, camera, factor } = this.view;
    if (camera.elevation > STEEP) return;
    const corners = ground.corners.map(([x, y]) => [x, y, this.at(x, y, ground.z)[0]]);
    const [x, y] = corners.reduce((left, corner) => (corner[2] < left[2] ? corner : left));
    const foot = this.at(x, y, ground.z);
    const top = this.at(x, y, ground.top);
    if (foot[2] <= 0 || top[2] <= 0 || Math.hypot(top[0] - foot[0], top[1] - foot[1]) < 1.5 * LABEL) return;
    Object.assign(context, { strokeStyle: colours.soft, lineWidth: 1 });
    context.beginPath();
    context.moveTo(foot[0], foot[1]);
    context.lineTo(top[0], top[1]);
    for (const z of ground.heights) {
      const [px, py] = this.at(x, y, z);
      context.moveTo(px - 4, py);
      context.lineTo(px + 4, py);
    }
    context.stroke();
    const decimals = decimalsOf(ground.heightStep);
    for (const z of ground.heights) {
      if (z < ground.z + CLEAR * ground.heightStep) continue; // a label of the grid stands there
      const [px, py] = this.at(x, y, z);
      this._text(number(z, decimals), [[px - 7, py, "right"]]);
    }
    /** @type {TextPlace[]} */
    const places = [[top[0], top[1] - LABEL, "center"], [top[0] + 7, top[1], "left"], [top[0], top[1] - 2 * LABEL, "center"]];
    this._text(factor > 1 ? `z [mm] × ${factor}` : "z [mm]", places, { always: true });
  }

  /** The directions of x, y and z, and that the numbers are mm. */
  _triad() {
    const { context, colours } = this;
    const { camera, height } = this.view;
    /** @type {[number, number]} */
    const origin = [CORNER, height - CORNER];
    ["x", "y", "z"].forEach((name, axis) => {
      /** @param {import("three").Vector3} vector */
      const parts = (vector) => vector.toArray()[axis];
      const dx = ARROW * parts(camera.right);
      const dy = -ARROW * parts(camera.up);
      Object.assign(context, { strokeStyle: colours.ink, lineWidth: 1.5 });
      context.beginPath();
      context.moveTo(...origin);
      context.lineTo(origin[0] + dx, origin[1] + dy);
      context.stroke();
      const long = Math.hypot(dx, dy);
      if (long < 4) return; // it points at the eye
      const share = 1 + 9 / long;
      /** @type {TextPlace} */
      const end = [origin[0] + share * dx, origin[1] + share * dy, "center"];
      this._text(name, [end], { fillStyle: colours.ink });
    });
    this._text("grid in mm", [[8, height - 10, "left"]]);
  }

  /** What is marked along the beads. */
  _marks() {}

  /** Mark a row as the worst place. @param {number} row @param {string} ink */
  _worst(row, ink) {
    const { context } = this;
    const [px, py] = this.view.projectRow(row, this.place);
    context.beginPath();
    context.moveTo(px, py - 5);
    context.lineTo(px - 5, py - 14);
    context.lineTo(px + 5, py - 14);
    context.closePath();
    Object.assign(context, { strokeStyle: ink, lineWidth: 2 });
    context.stroke();
    /** @type {TextPlace[]} */
    const places = [[px + 9, py - 11, "left"], [px - 9, py - 11, "right"], [px, py - 24, "center"]];
    this._text("worst", places, { fillStyle: ink, always: true });
    // of the mark, and of the cursor that begins there
    this.texts.keep([px - 8, py - 14, px + 8, py + 8]);
  }

  /** Rings around the cursor's places, and plumb lines to the ground. */
  _cursor() {
    const { context, colours } = this;
    const { cursor, ground } = this.view;
    for (const { x, y, z, colour } of this.view.marksAt(cursor.row)) {
      const [px, py, depth] = this.at(x, y, z);
      if (!(depth > 0)) continue;
      const foot = this.at(x, y, ground.z);
      context.beginPath();
      context.moveTo(px, py);
      context.lineTo(foot[0], foot[1]);
      Object.assign(context, { strokeStyle: colours.soft, lineWidth: 1 });
      context.setLineDash([4, 3]);
      context.stroke();
      context.setLineDash([]);
      const ink = colour ?? colours.ink;
      /** @type {[number, string][]} */
      const rings = [[5, colours.paper], [2.5, ink]];
      for (const [size, shade] of rings) {
        context.beginPath();
        context.arc(px, py, 7, 0, 2 * Math.PI);
        Object.assign(context, { strokeStyle: shade, lineWidth: size });
        context.stroke();
      }
      if (!cursor.pinned) continue;
      context.beginPath();
      context.arc(px, py, 2.5, 0, 2 * Math.PI);
      context.fillStyle = ink;
      context.fill();
    }
  }
}

/** Over the picture of a run: the chosen line of the program, where glue begins and ends, and the worst place. */
export class RunLabels extends Labels {
  /** @param {Scene3d<RunData>} view */
  constructor(view) {
    super(view);
    this.data = view.data;
  }

  _marks() {
    this._chosen();
    this._ends();
  }

  /** The stretches of the chosen program line. */
  _chosen() {
    const { context, colours } = this;
    const { data } = this;
    const { cursor } = this.view;
    if (!cursor.line) return;
    context.beginPath();
    for (const [first, last] of stretches(data.rows, (row) => data.column.line[row] === cursor.line)) {
      for (let row = first; row <= last; row++) {
        const [px, py] = this.view.projectRow(row, this.place);
        if (row === first) context.moveTo(px, py);
        else context.lineTo(px, py);
      }
    }
    Object.assign(context, { strokeStyle: colours.paper, lineWidth: 4 });
    context.stroke();
    Object.assign(context, { strokeStyle: colours.ink, lineWidth: 2 });
    context.stroke();
  }

  /** Mark where the dispenser first opens and last closes, and the worst place. */
  _ends() {
    const { context, colours } = this;
    const { data } = this;
    const glue = stretches(data.rows, (row) => data.column.dispense[row]);
    if (!glue.length) return;
    /** @type {[string, TextPlace[], TextLooks][]} */
    const marks = [];
    /** @type {[number, string][]} */
    const ends = [[glue[0][0], "start"], [glue[glue.length - 1][1], "end"]];
    for (const [row, name] of ends) {
      const [px, py] = this.view.projectRow(row, this.place);
      context.beginPath();
      context.arc(px, py, 3.5, 0, 2 * Math.PI);
      context.fillStyle = colours.ink;
      context.fill();
      marks.push([name, around(px, py, 9), { fillStyle: colours.ink }]);
    }
    this._worst(data.worst, data.passes ? colours.ink : colours.alarm);
    for (const mark of marks) this._text(...mark);
  }
}
