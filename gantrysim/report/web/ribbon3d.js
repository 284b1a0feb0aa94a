// The bead as a body swept along the path, half an ellipse as wide and high as the bead is there.

import { BufferAttribute, BufferGeometry, DoubleSide, Mesh, MeshBasicMaterial } from "three";

const DRY = 0.02; // of the nominal width; a narrower bead is none
const NARROW = 0.01; // of the bead's longest extent: the width of a bead whose width is unknown
const FLAT = 0.2; // height over width of such a bead
const APART = 0.02; // of the width, from ring to ring; a nozzle at rest makes no rings
const CORNERS = 9; // of a ring
const EDGE = 0.62; // brightness at the foot of the bead; its crest has the colour of the scale
const ANGLES = Array.from({ length: CORNERS }, (_, k) => (Math.PI * k) / (CORNERS - 1));
const SHADES = ANGLES.map((angle) => EDGE + (1 - EDGE) * Math.sin(angle));

/**
 * Rows at which the bead has a ring, and whether a ring is joined to the one before.
 *
 * @param {BeadInSpace} data @param {number} extent
 */
function ringsOf(data, extent) {
  const { x, y, width, dispense } = data.column;
  const least = DRY * (data.width || 0);
  const rows = [];
  const joined = [];
  let wet = false;
  for (let row = 0; row < data.rows; row++) {
    const glue = width ? width[row] > least : dispense[row] > 0;
    if (glue) {
      const last = rows[rows.length - 1];
      const size = width ? width[row] : NARROW * extent;
      const step = wet ? Math.hypot(x[row] - x[last], y[row] - y[last]) : Infinity; // glue stays below a rising nozzle
      if (step > APART * size) {
        rows.push(row);
        joined.push(wet);
      }
    }
    wet = glue;
  }
  return { rows, joined };
}

/**
 * Level unit vectors across the path at the rings, [x, y, x, ...]; a vertical stretch keeps the one before.
 *
 * @param {BeadInSpace} data @param {number[]} rows @param {boolean[]} joined
 */
function acrossOf(data, rows, joined) {
  const { x, y } = data.column;
  const across = new Float32Array(2 * rows.length);
  let nx = 1;
  let ny = 0;
  rows.forEach((row, k) => {
    const before = joined[k] ? rows[k - 1] : row;
    const after = joined[k + 1] ? rows[k + 1] : row;
    const dx = x[after] - x[before];
    const dy = y[after] - y[before];
    const length = Math.hypot(dx, dy);
    if (length > 1e-6) [nx, ny] = [-dy / length, dx / length];
    across[2 * k] = nx;
    across[2 * k + 1] = ny;
  });
  return across;
}

export class Ribbon {
  /** @param {BeadInSpace} data @param {Frame} frame the middle @param {number} extent of the bead [mm] */
  constructor(data, frame, extent) {
    const { rows, joined } = ringsOf(data, extent);
    this.rows = rows;
    this.geometry = new BufferGeometry();
    this.geometry.setAttribute("position", new BufferAttribute(this._corners(data, joined, frame, extent), 3));
    this.colours = new BufferAttribute(new Uint8Array(3 * CORNERS * rows.length), 3, true);
    this.geometry.setAttribute("color", this.colours);
    this.geometry.setIndex(new BufferAttribute(this._faces(joined), 1));
    this.object = new Mesh(this.geometry, new MeshBasicMaterial({ vertexColors: true, side: DoubleSide }));
  }

  /** @param {BeadInSpace} data @param {Frame} frame @param {number} extent @param {boolean[]} joined */
  _corners(data, joined, frame, extent) {
    const { x, y, z, width, height } = data.column;
    const across = acrossOf(data, this.rows, joined);
    const corners = new Float32Array(3 * CORNERS * this.rows.length);
    const gap = data.space?.gap ?? 0;
    let place = 0;
    this.rows.forEach((row, k) => {
      const half = (width ? width[row] : NARROW * extent) / 2;
      const high = height ? height[row] : 2 * FLAT * half;
      const foot = z[row] - gap - frame.z;
      for (const angle of ANGLES) {
        const aside = half * Math.cos(angle);
        corners[place++] = x[row] - frame.x + aside * across[2 * k];
        corners[place++] = y[row] - frame.y + aside * across[2 * k + 1];
        corners[place++] = foot + high * Math.sin(angle);
      }
    });
    return corners;
  }

  /** @param {boolean[]} joined */
  _faces(joined) {
    const faces = new Uint32Array(6 * (CORNERS - 1) * joined.filter(Boolean).length);
    let place = 0;
    joined.forEach((tied, ring) => {
      if (!tied) return;
      for (let k = 0; k < CORNERS - 1; k++) {
        const a = ring * CORNERS + k;
        const b = a - CORNERS;
        faces.set([a, b, a + 1, a + 1, b, b + 1], place);
        place += 6;
      }
    });
    return faces;
  }

  /** Colour the bead by a function from a row to [red, green, blue]. @param {(row: number) => Rgb} colourAt */
  paint(colourAt) {
    const { array } = this.colours;
    let place = 0;
    for (const row of this.rows) {
      const colour = colourAt(row);
      for (const shade of SHADES) for (const part of colour) array[place++] = shade * part;
    }
    this.colours.needsUpdate = true;
  }
}
