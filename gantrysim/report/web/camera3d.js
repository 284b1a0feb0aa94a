// A camera that turns about a target, in a frame whose z points up, and where points appear in its picture.

import { Matrix4, PerspectiveCamera, Vector3 } from "three";

const FIELD_OF_VIEW = 35; // vertical, as of the films [deg]
const MARGIN = 1.06; // half width and height of the picture over those of what it shows
const CENTRINGS = 4; // a perspective's middle is found step by step
const STEEPEST = 90; // elevation of a view straight down [deg]
const LOWEST = -60;
const NEAREST = 0.02; // distance over the one that shows everything
const FARTHEST = 8;
const RADIANS = Math.PI / 180;
const HALF = Math.tan((FIELD_OF_VIEW / 2) * RADIANS);

export class Camera {
  /** @type {number} */ azimuth;
  /** @type {number} */ elevation;
  /** @type {number[]} */ _middle;

  /** @param {{azimuth: number, elevation: number}} home direction in which the camera looks at first [deg] */
  constructor(home) {
    this.home = home;
    this.distance = 1;
    this.whole = 1; // distance that shows everything
    this.three = new PerspectiveCamera(FIELD_OF_VIEW, 1, 1, 1000);
    this.three.matrixAutoUpdate = false;
    this.target = new Vector3();
    this.forward = new Vector3();
    this.right = new Vector3();
    this.up = new Vector3();
    this._picture = new Matrix4();
    this.look(home.azimuth, home.elevation);
  }

  /**
   * Look into a direction: azimuth from x about z, and degrees downwards.
   *
   * @param {number} azimuth @param {number} elevation
   */
  look(azimuth, elevation) {
    this.azimuth = ((azimuth % 360) + 360) % 360;
    this.elevation = Math.min(Math.max(elevation, LOWEST), STEEPEST);
    const a = this.azimuth * RADIANS;
    const e = this.elevation * RADIANS;
    this.forward.set(Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), -Math.sin(e));
    this.right.set(Math.sin(a), -Math.cos(a), 0);
    this.up.crossVectors(this.right, this.forward);
  }

  /**
   * Show all points, [x, y, z, x, ...], from the direction in which the camera looks, in the middle of the picture.
   *
   * @param {number[]} points @param {number} aspect
   */
  fit(points, aspect) {
    const { target, right, up } = this;
    target.set(0, 0, 0);
    for (let turn = 0; turn < CENTRINGS; turn++) {
      const places = this._seen(points);
      this.distance = 0;
      for (const [aside, above, ahead] of places) {
        const size = Math.max(Math.abs(aside) / aspect, Math.abs(above));
        this.distance = Math.max(this.distance, (MARGIN * size) / HALF - ahead);
      }
      if (turn + 1 === CENTRINGS) break;
      /** @param {number} axis */
      const middle = (axis) => {
        const slopes = places.map((place) => place[axis] / (this.distance + place[2]));
        return (this.distance * (Math.min(...slopes) + Math.max(...slopes))) / 2;
      };
      target.addScaledVector(right, middle(0)).addScaledVector(up, middle(1));
    }
    this.whole = this.distance;
  }

  /** Points relative to the target, [right, up, forward]. @param {number[]} points */
  _seen(points) {
    const point = new Vector3();
    /** @type {number[][]} */
    const places = [];
    for (let k = 0; k < points.length; k += 3) {
      point.set(points[k], points[k + 1], points[k + 2]).sub(this.target);
      places.push([point.dot(this.right), point.dot(this.up), point.dot(this.forward)]);
    }
    return places;
  }

  /** Size [mm] of a pixel at the target. @param {number} height */
  pixel(height) {
    return (2 * this.distance * HALF) / height;
  }

  /** @param {number} dx @param {number} dy @param {number} height */
  pan(dx, dy, height) {
    const size = this.pixel(height);
    this.target.addScaledVector(this.right, -dx * size).addScaledVector(this.up, dy * size);
  }

  /**
   * Zoom by a factor about a place [pixels] from the middle of the picture.
   *
   * @param {number} factor @param {number} x @param {number} y @param {number} height
   */
  zoom(factor, x, y, height) {
    const before = this.distance;
    this.distance = Math.min(Math.max(before / factor, NEAREST * this.whole), FARTHEST * this.whole);
    const share = 1 - this.distance / before;
    this.pan(-share * x * (before / this.distance), -share * y * (before / this.distance), height);
  }

  /**
   * Set the camera of three.js for a picture of a size [pixels]; reach is the farthest thing drawn [mm].
   *
   * @param {number} width @param {number} height @param {number} reach
   */
  place(width, height, reach) {
    const { three, distance, target, forward, right, up } = this;
    three.aspect = width / height;
    three.near = distance / 60;
    three.far = distance + reach;
    three.updateProjectionMatrix();
    const back = forward.clone().negate();
    three.matrix.makeBasis(right, up, back).setPosition(target.clone().addScaledVector(back, distance));
    three.updateMatrixWorld(true);
    this._picture.multiplyMatrices(three.projectionMatrix, three.matrixWorldInverse);
    this._middle = [width / 2, height / 2];
  }

  /**
   * Write place in the picture and distance of a point to [x, y, depth]; the depth is negative behind the camera.
   *
   * @param {number} x @param {number} y @param {number} z @param {number[]} result
   */
  project(x, y, z, result) {
    const m = this._picture.elements;
    const depth = m[3] * x + m[7] * y + m[11] * z + m[15];
    const [px, py] = this._middle;
    result[0] = px + (px * (m[0] * x + m[4] * y + m[8] * z + m[12])) / depth;
    result[1] = py - (py * (m[1] * x + m[5] * y + m[9] * z + m[13])) / depth;
    result[2] = depth;
    return result;
  }
}
