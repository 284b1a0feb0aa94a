// The machine in plain translucent boxes and cylinders, posed at any tick of the run.

import {
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  CapsuleGeometry,
  CylinderGeometry,
  EdgesGeometry,
  Group,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  Quaternion,
  SphereGeometry,
  Vector3,
} from "three";
import { decode } from "./data.js";

const SIDES = 20; // of a round solid
const SHARP = 30; // angle of an edge that is drawn [deg]
const FACE = 0.03; // opacity, of which many lie one behind the other
const EDGE = 0.17;
const WIDE = 700; // picture from which on edges have this opacity [pixels]
const NEEDLE = 0.75; // opacity of the needle, which is small

/** @type {SpaceContent} */
const NO_MACHINE = { gap: 0, poses: 0, parts: [] };

/** A solid's geometry: kind, three sizes, position, quaternion w, x, y, z and whether it is the needle, see gantrysim/report/space_data.py. @param {Solid} solid */
function shapeOf([kind, a, b, c]) {
  if (kind === "box") return new BoxGeometry(2 * a, 2 * b, 2 * c);
  if (kind === "ball") return new SphereGeometry(a, SIDES, SIDES / 2);
  const shape = kind === "capsule" ? new CapsuleGeometry(a, 2 * b, 4, SIDES) : new CylinderGeometry(a, a, 2 * b, SIDES);
  return shape.rotateX(Math.PI / 2); // from along y to along z
}

/** @param {BufferGeometry[]} geometries */
function joined(geometries) {
  const arrays = geometries.map((geometry) => geometry.attributes.position.array);
  const all = new Float32Array(arrays.reduce((sum, array) => sum + array.length, 0));
  let place = 0;
  for (const array of arrays) {
    all.set(array, place);
    place += array.length;
  }
  return new BufferGeometry().setAttribute("position", new BufferAttribute(all, 3));
}

/**
 * The value at a place between samples by Hermite's cubic, whose slopes are those between the neighbours.
 *
 * @param {ArrayLike<number>} ticks @param {ArrayLike<number>} values @param {number} k @param {number} tick
 */
function cubic(ticks, values, k, tick) {
  const last = values.length - 1;
  /** @param {number} i */
  const slope = (i) => {
    const low = Math.max(i - 1, 0);
    const high = Math.min(i + 1, last);
    return (values[high] - values[low]) / (ticks[high] - ticks[low]);
  };
  const step = ticks[k + 1] - ticks[k];
  const t = (tick - ticks[k]) / step;
  const rest = 1 - t;
  return (
    values[k] * (1 + 2 * t) * rest * rest +
    values[k + 1] * (3 - 2 * t) * t * t +
    step * t * rest * (slope(k) * rest - slope(k + 1) * t)
  );
}

export class MachineOutline {
  /** @param {RunData} data @param {Frame} frame */
  constructor(data, frame) {
    const { parts, poses } = data.space ?? NO_MACHINE;
    const solids = data.solids ?? [];
    const last = data.ticks - 1;
    this.frame = frame;
    this.ticks = Float64Array.from({ length: poses }, (_, k) => Math.round((k * last) / Math.max(poses - 1, 1)));
    this.object = new Group();
    this.faces = new MeshBasicMaterial({ transparent: true, opacity: FACE, depthWrite: false });
    this.edges = new LineBasicMaterial({ transparent: true, opacity: EDGE, depthWrite: false });
    this.needle = new MeshBasicMaterial({ transparent: true, opacity: NEEDLE });
    this.parts = parts.map((part, k) => this._part(part, solids[k], poses));
  }

  /** @param {PartContent} part @param {Solid[]} solids @param {number} poses */
  _part({ pose }, solids, poses) {
    const shapes = solids.map((solid) => {
      const [, , , , px, py, pz, w, x, y, z] = solid;
      const matrix = new Matrix4().compose(
        new Vector3(px, py, pz),
        new Quaternion(x, y, z, w).normalize(),
        new Vector3(1, 1, 1),
      );
      return shapeOf(solid).applyMatrix4(matrix);
    });
    const group = new Group();
    /** @param {boolean} needle */
    const faces = (needle) => joined(shapes.filter((_, k) => solids[k][11] === needle).map((shape) => shape.toNonIndexed()));
    group.add(new Mesh(faces(false), this.faces), new Mesh(faces(true), this.needle));
    group.add(new LineSegments(joined(shapes.map((shape) => new EdgesGeometry(shape, SHARP))), this.edges));
    this.object.add(group);
    const columns = pose.map((column) => (typeof column === "number" ? column : decode(column, poses)));
    return { group, columns };
  }

  /** Pose the machine at a tick of the run. @param {number} tick */
  pose(tick) {
    const { ticks, frame } = this;
    let low = 0;
    let high = ticks.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (ticks[middle] <= tick) low = middle;
      else high = middle;
    }
    for (const { group, columns } of this.parts) {
      /** @param {number | Values} column */
      const value = (column) => (typeof column === "number" ? column : high ? cubic(ticks, column, low, tick) : column[0]);
      const [x, y, z, qw, qx, qy, qz] = columns.map(value);
      group.position.set(x - frame.x, y - frame.y, z - frame.z);
      group.quaternion.set(qx, qy, qz, qw).normalize();
    }
  }

  /** Draw fainter lines in a narrow picture [pixels], where they lie closer together. @param {number} width */
  fade(width) {
    this.edges.opacity = EDGE * Math.min(width / WIDE, 1);
  }

  /** @param {string} colour @param {string} needle */
  paint(colour, needle) {
    this.faces.color.set(colour);
    this.edges.color.set(colour);
    this.needle.color.set(needle);
  }
}
