// The ground below a bead: a grid in mm, the scale of heights at its corner, and where their labels are.

import { BufferAttribute, BufferGeometry, LineBasicMaterial, LineSegments } from "three";

const LINES = 5; // of the grid, about
const BEYOND = 0.04; // of its extent, from the bead to the edge of the grid
const HEIGHTS = 4; // labels of the scale of heights, about

/** A round step, 1, 2 or 5 times a power of ten, not below a size. @param {number} size */
export function roundStep(size) {
  const decade = 10 ** Math.floor(Math.log10(size));
  return [1, 2, 5].map((digit) => digit * decade).find((step) => step >= size * 0.999) ?? 10 * decade;
}

/** @param {number} low @param {number} high @param {number} step */
export function steps(low, high, step) {
  const first = Math.ceil(low / step - 1e-6);
  const count = Math.floor(high / step + 1e-6) - first;
  return Array.from({ length: Math.max(count + 1, 0) }, (_, k) => (first + k) * step);
}

/** A square of the ground a little larger than the bead, with lines at round places. */
export class Ground {
  /** @param {Box3} box of the bead [mm] @param {Frame} frame its middle */
  constructor(box, frame) {
    const wide = Math.max(box.x[1] - box.x[0], box.y[1] - box.y[0]);
    this.step = roundStep(wide / LINES);
    this.z = box.z[0];
    this.top = box.z[1];
    /** @param {[number, number]} range @returns {[number, number]} */
    const around = ([low, high]) => [low - BEYOND * wide, high + BEYOND * wide];
    this.x = around(box.x);
    this.y = around(box.y);
    this.heightStep = roundStep(Math.max(this.top - this.z, 1e-3) / HEIGHTS);
    this.heights = steps(this.z, this.top, this.heightStep);
    this.material = new LineBasicMaterial();
    const ends = [];
    for (const x of [...this.x, ...steps(...this.x, this.step)]) ends.push([x, this.y[0]], [x, this.y[1]]);
    for (const y of [...this.y, ...steps(...this.y, this.step)]) ends.push([this.x[0], y], [this.x[1], y]);
    const points = ends.flatMap(([x, y]) => [x - frame.x, y - frame.y, this.z - frame.z]);
    const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
    this.object = new LineSegments(geometry, this.material);
  }

  /** @param {string} colour */
  paint(colour) {
    this.material.color.set(colour);
  }

  get corners() {
    return this.x.flatMap((x) => this.y.map((y) => [x, y, this.z]));
  }
}
