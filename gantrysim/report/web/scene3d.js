// What 3-D views have in common: the ground, a camera that is turned and zoomed, and the cursor, drawn by three.js.

import {
  BufferAttribute,
  BufferGeometry,
  ColorManagement,
  Group,
  LineBasicMaterial,
  LineSegments,
  LinearSRGBColorSpace,
  Scene,
  WebGLRenderer,
} from "three";
import { Camera } from "./camera3d.js";
import { asSlider } from "./cursor.js";
import { extent } from "./data.js";
import { contextOf, element, toggle } from "./dom.js";
import { Ground } from "./ground3d.js";
import { onTheme, theme } from "./theme.js";
import { turning } from "./turning.js";

const HOME = { azimuth: 65, elevation: 32 }; // the bridge of a gantry is behind the needle [deg]
const REACH = 30; // pixels from the path within which hovering finds it
const SAME = 3; // pixels within which two points of the path are as near to the mouse
const FLAT = 0.12; // height over extent of a bead below which its heights may be magnified
const MAGNIFIED = 5;
const LABELS = 36; // width beside the picture's content for the scale of heights [pixels]
const MOST_POINTS = 3000; // of the bead to which a view is fitted
const FARTHEST = 6000; // from the target to the end of what is drawn [mm]
const MOST_RATIO = 2; // pixels drawn for each of the page
const HINT =
  "Drag turns, Shift-drag moves, the wheel or two fingers zoom once the view was clicked. Keys: W A S D turn (with Shift " +
  "they move), + − zoom, 0 resets.";

ColorManagement.enabled = false; // colours are those of the page's scales, as they are

/**
 * A picture in space of beads; what is in it, its caption and its words are those of the classes that extend it.
 *
 * @template {RunData | ComparedData} Data
 */
export class Scene3d {
  /** @type {number} size of the picture [pixels] */ width;
  /** @type {number} */ height;
  /** @type {number} */ ratio;
  /** @type {Frame} the middle of the beads, from which positions are counted [mm] */ frame;
  /** @type {number} their longest extent [mm] */ size;
  /** @type {Box3} around them [mm] */ box;
  /** @type {Ground} */ ground;
  /** @type {Labels} */ labels;
  /** @type {Scale3d | undefined} of a run's colours */ scale;
  /** @type {LineBasicMaterial} of the way without glue */ travel;
  /** @type {LineBasicMaterial} of the needle's way through its own glue */ alarm;
  /** @type {LineBasicMaterial} of the beads' shadows on the ground */ shade;
  /** @type {boolean} whether the whole bead is shown */ whole;
  /** @type {boolean} whether the data have changed since it was built */ outdated;
  /** @type {boolean} */ stale;
  /** @type {boolean} */ inSight;
  /** @type {number} of the frame that is waited for, 0 for none */ frameWanted;

  /** @param {Data} data @param {Cursor} cursor */
  constructor(data, cursor) {
    this.data = data;
    this.cursor = cursor;
    this.factor = 1; // of the heights
    this.camera = new Camera(HOME);
    this.labels = this._labels();
    this.renderer = new WebGLRenderer({ antialias: true });
    this.renderer.outputColorSpace = LinearSRGBColorSpace;
    this.scene = new Scene();
    this.root = new Group();
    this.scene.add(this.root);
    this._build();
    this.base = this.renderer.domElement;
    this.base.setAttribute("aria-hidden", "true");
    this.top = element("canvas", { "aria-hidden": "true" });
    this.surface = element("div", { class: "surface" }, this.base, this.top);
    asSlider(this.surface, cursor, "", (row) => this._described(row));
    this.surface.setAttribute("aria-keyshortcuts", "W A S D + - 0");
    this.children = [this._caption(), this.surface, element("p", { class: "hint" }, HINT)];
    this._listen();
    this._paint();
  }

  /** The points of the beads, [x, y, z] of the nozzle, and the heights at which they lie [mm]. @returns {{ points: number[][], low: number }} */
  _beads() {
    throw new Error("of no bead");
  }

  /** What is written over the picture. @returns {Labels} */
  _labels() {
    throw new Error("over no picture");
  }

  /** The caption, with what can be chosen. @returns {HTMLElement} */
  _caption() {
    return element("figcaption", {}, element("b", {}, "Bead in 3-D"), ...this._looks());
  }

  /** The text alternative at a row. @param {number} row */
  _described(row) {
    return `row ${row}`;
  }

  /** Give everything the colours of the page. */
  _paint() {
    const colours = theme();
    this.renderer.setClearColor(colours.paper);
    this.ground.paint(colours.line);
    this.travel.color.set(colours.soft);
    this.alarm.color.set(colours.alarm);
    this.shade.color.set(colours.soft);
    this._redraw();
  }

  /** Move what depends on the cursor before a picture is drawn. */
  _pose() {}

  /** Whether a move of the cursor changes more than what is written over the picture. */
  get _moves() {
    return false;
  }

  /** Points at which the cursor is marked, with their colours. @param {number} row @returns {(Frame & { colour: string | null })[]} */
  marksAt(row) {
    const [x, y, z] = this.pointAt(row);
    return [{ x, y, z, colour: null }];
  }

  /** The place of a row, at which the mouse finds it [mm]. @param {number} row @returns {number[]} */
  pointAt(row) {
    return [NaN, NaN, row];
  }

  /** The box around the beads, in whose middle the camera looks. */
  _build() {
    const { points, low } = this._beads();
    /** @param {number} axis */
    const range = (axis) => extent(points.map((point) => point[axis]));
    this.box = { x: range(0), y: range(1), z: [low, range(2)[1]] };
    /** @param {number[]} range */
    const middle = ([least, most]) => (least + most) / 2;
    this.frame = { x: middle(this.box.x), y: middle(this.box.y), z: middle(this.box.z) };
    this.size = Math.max(...Object.values(this.box).map(([least, most]) => most - least));
    this.ground = new Ground(this.box, this.frame);
    this.travel = new LineBasicMaterial({ transparent: true, opacity: 0.7 });
    this.alarm = new LineBasicMaterial({ depthTest: false, transparent: true }); // also seen inside the bead
    this.shade = new LineBasicMaterial({ transparent: true, opacity: 0.45 });
    this.root.add(this.ground.object);
  }

  /** Show other data of the run, from where the camera looks. */
  update() {
    this.outdated = true; // built anew when it is drawn, as it may be out of sight
    this._redraw();
  }

  /** Give the graphics context back: browsers allow few at a time. */
  remove() {
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  _rebuild() {
    this.outdated = false;
    this.root.traverse((/** @type {any} three's types do not tell meshes from groups */ { geometry, material }) => {
      geometry?.dispose();
      material?.dispose();
    });
    this.root.clear();
    this._build();
    this._paint();
    if (this.whole) this._fit();
  }

  /**
   * Lines along a bead where a condition holds, at a height.
   *
   * @param {BeadInSpace} bead @param {(row: number) => unknown} holds @param {(row: number) => number} heightAt
   * @param {LineBasicMaterial} material
   */
  _lines({ rows, column: { x, y } }, holds, heightAt, material) {
    const { frame } = this;
    const points = [];
    for (let row = 1; row < rows; row++) {
      if (!holds(row) || isNaN(x[row]) || isNaN(x[row - 1])) continue;
      for (const end of [row - 1, row]) points.push(x[end] - frame.x, y[end] - frame.y, heightAt(end) - frame.z);
    }
    const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
    return new LineSegments(geometry, material);
  }

  /** Buttons for the directions in which one looks, and for heights that are small beside the extent. */
  _looks() {
    /** @param {string} label @param {() => void} action @param {string} [title] */
    const press = (label, action, title) => {
      const button = element("button", { type: "button", title }, label);
      button.addEventListener("click", action);
      return button;
    };
    /** @param {number} azimuth @param {number} elevation */
    const look = (azimuth, elevation) => () => {
      this.camera.look(azimuth, elevation);
      this._fit();
    };
    const buttons = [];
    if (this.box.z[1] - this.box.z[0] < FLAT * this.size) {
      /** @param {boolean} on */
      const magnify = (on) => {
        this.factor = on ? MAGNIFIED : 1;
        this.root.scale.z = this.factor;
        this._fit();
      };
      buttons.push(toggle(`z × ${MAGNIFIED}`, false, magnify, { title: "draw heights magnified" }));
    }
    buttons.push(
      press("top", look(90, 90), "look straight down, as the plan does"),
      press("side", look(90, 0), "look along y"),
      press("reset", () => this._reset(), "the first view; also a double click or the key 0"),
    );
    return buttons;
  }

  _listen() {
    turning(this.surface, {
      hover: (x, y) => this._find(x, y, (row) => this.cursor.hover(row, this)),
      click: (x, y) => this._find(x, y, (row) => this.cursor.pin(row, this)),
      turn: (azimuth, elevation) => {
        this.camera.look(this.camera.azimuth - azimuth, this.camera.elevation + elevation);
        this._redraw();
      },
      pan: (dx, dy) => {
        this.whole = false;
        this.camera.pan(dx, dy, this.height);
        this._redraw();
      },
      zoom: (factor, x = this.width / 2, y = this.height / 2) => {
        this.whole = false;
        this.camera.zoom(factor, x - this.width / 2, y - this.height / 2, this.height);
        this._redraw();
      },
      reset: () => this._reset(),
    });
    this.cursor.onMove(() => this._redraw(this._moves));
    this.cursor.onChoice(() => this._redraw());
    onTheme(() => this._paint());
    new ResizeObserver(() => this._resize()).observe(this.surface);
    new IntersectionObserver((entries) => {
      this.inSight = entries[entries.length - 1].isIntersecting;
      this._redraw();
    }).observe(this.surface);
  }

  _reset() {
    this.camera.look(HOME.azimuth, HOME.elevation);
    this._fit();
  }

  _resize() {
    const first = !this.width;
    this.width = this.surface.clientWidth;
    this.height = this.surface.clientHeight;
    if (!this.width || !this.height) return;
    const ratio = Math.min(window.devicePixelRatio || 1, MOST_RATIO);
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(this.width, this.height, false);
    Object.assign(this.top, { width: Math.round(this.width * ratio), height: Math.round(this.height * ratio) });
    this.ratio = ratio;
    if (first) this._fit();
    this._redraw();
  }

  /** Show the whole bead from where the camera looks. */
  _fit() {
    this.whole = true; // until it is moved or zoomed
    const { frame, factor } = this;
    const { points: laid } = this._beads();
    const every = Math.ceil(laid.length / MOST_POINTS);
    const { corners, top } = this.ground;
    const { right } = this.camera;
    /** @param {number[]} corner */
    const aside = (corner) => corner[0] * right.x + corner[1] * right.y;
    const left = corners.reduce((first, corner) => (aside(corner) < aside(first) ? corner : first));
    const scale = [left[0], left[1], top]; // of heights, which stands there
    const places = [...laid.filter((_, k) => k % every === 0), ...corners, scale];
    const points = places.flatMap((place) => [place[0] - frame.x, place[1] - frame.y, factor * (place[2] - frame.z)]);
    this.camera.fit(points, Math.max(this.width - 2 * LABELS, 1) / this.height);
    this._redraw();
  }

  /** @param {number} x @param {number} y @param {number} z @param {number[]} result */
  project(x, y, z, result) {
    const { frame, factor } = this;
    return this.camera.project(x - frame.x, y - frame.y, factor * (z - frame.z), result);
  }

  /** @param {number} row @param {number[]} result */
  projectRow(row, result) {
    const [x, y, z] = this.pointAt(row);
    return this.project(x, y, z, result);
  }

  /** Draw once before the next picture, if the view is in sight: all of it, or only what is written over it. */
  _redraw(whole = true) {
    this.stale = this.stale || whole;
    if (this.frameWanted || !this.inSight || !this.width) return;
    this.frameWanted = requestAnimationFrame(() => {
      this.frameWanted = 0;
      this._draw();
    });
  }

  _draw() {
    if (this.outdated) this._rebuild();
    const { camera } = this;
    if (this.stale) {
      this._pose();
      camera.place(this.width, this.height, FARTHEST);
      this.renderer.render(this.scene, camera.three);
      this.stale = false;
    }
    const context = contextOf(this.top);
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    this.labels.draw(context, theme());
    const { azimuth, elevation, distance, target } = camera;
    this.surface.dataset.view = [azimuth, elevation, distance, ...target.toArray()].map((v) => v.toPrecision(7)).join(" ");
  }

  /**
   * Find the row nearest to the mouse; of stretches that cross there, the one in front.
   *
   * @param {number} px @param {number} py @param {(row: number) => void} found
   */
  _find(px, py, found) {
    const { data } = this;
    const place = [0, 0, 0];
    const places = new Float32Array(2 * data.rows);
    let least = REACH;
    for (let row = 0; row < data.rows; row++) {
      this.projectRow(row, place);
      const away = place[2] > 0 ? Math.hypot(place[0] - px, place[1] - py) : Infinity;
      places[2 * row] = away;
      places[2 * row + 1] = place[2];
      if (away < least) least = away;
    }
    if (least === REACH) return;
    let front = Infinity;
    for (let row = 0; row < data.rows; row++) {
      if (places[2 * row] <= least + SAME && places[2 * row + 1] < front) front = places[2 * row + 1];
    }
    const behind = front + 0.02 * this.size; // still the stretch in front
    let nearest = -1;
    for (let row = 0; row < data.rows; row++) {
      if (places[2 * row + 1] > behind || places[2 * row] > least + SAME) continue;
      if (nearest < 0 || places[2 * row] < places[2 * nearest]) nearest = row;
    }
    found(nearest);
  }
}
