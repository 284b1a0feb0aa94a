// The 3-D view of the bead: coloured by its error or its width, with the cursor and the machine, drawn by three.js.

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
import { element, toggle } from "./dom.js";
import { Dots } from "./dots3d.js";
import { Ground } from "./ground3d.js";
import { Labels } from "./labels3d.js";
import { MachineOutline } from "./machine3d.js";
import { Ribbon } from "./ribbon3d.js";
import { Scale3d } from "./scale3d.js";
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

export class View {
  /** @param {RunData} data @param {Cursor} cursor */
  constructor(data, cursor) {
    this.data = data;
    this.cursor = cursor;
    this.factor = 1; // of the heights
    this.scale = new Scale3d(data);
    this.camera = new Camera(HOME);
    this.labels = new Labels(this);
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

  /** The box around the bead, in whose middle the camera looks. */
  _measure() {
    const { data } = this;
    const { x, y, z, dispense } = data.column;
    const all = [...data.column.x.keys()];
    const laid = all.filter((row) => dispense[row]);
    this.laid = laid.length ? laid : all; // a dry run's path
    /** @param {Values} values */
    const only = (values) => this.laid.map((row) => values[row]);
    const box = { x: extent(only(x)), y: extent(only(y)), z: extent(only(z)) };
    box.z = [box.z[0] - data.space.gap, box.z[1]];
    /** @param {number[]} range */
    const middle = ([low, high]) => (low + high) / 2;
    this.frame = { x: middle(box.x), y: middle(box.y), z: middle(box.z) };
    this.size = Math.max(...Object.values(box).map(([low, high]) => high - low));
    this.box = box;
  }

  _build() {
    this._measure();
    const { data, frame } = this;
    this.ground = new Ground(this.box, frame);
    this.ribbon = new Ribbon(data, frame, this.size);
    this.dots = new Dots(data, frame);
    this.machine = new MachineOutline(data, frame);
    this.travel = new LineBasicMaterial({ transparent: true, opacity: 0.7 });
    this.shade = new LineBasicMaterial({ transparent: true, opacity: 0.45 });
    const { z } = data.column;
    const travel = this._lines((row) => !data.column.dispense[row], (row) => z[row], this.travel);
    const shade = this._lines((row) => data.column.dispense[row], () => this.ground.z, this.shade);
    this.root.add(this.ground.object, shade, travel, this.ribbon.object, this.dots.object, this.machine.object);
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
    const isShown = this.machine.object.visible;
    this.root.traverse((/** @type {any} three's types do not tell meshes from groups */ { geometry, material }) => {
      geometry?.dispose();
      material?.dispose();
    });
    this.root.clear();
    this._build();
    this.machine.object.visible = isShown;
    this.machine.fade(this.width);
    this.scale.update();
    this._paint();
    if (this.whole) this._fit();
  }

  /**
   * Lines along the path where a condition holds, at a height.
   *
   * @param {(row: number) => unknown} holds @param {(row: number) => number} heightAt @param {LineBasicMaterial} material
   */
  _lines(holds, heightAt, material) {
    const { data, frame } = this;
    const { x, y } = data.column;
    const points = [];
    for (let row = 1; row < data.rows; row++) {
      if (!holds(row)) continue;
      for (const end of [row - 1, row]) points.push(x[end] - frame.x, y[end] - frame.y, heightAt(end) - frame.z);
    }
    const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
    return new LineSegments(geometry, material);
  }

  _caption() {
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
    const machine = toggle("machine", true, (on) => {
      this.machine.object.visible = on;
      this._redraw();
    });
    const buttons = [machine];
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
    const colours = this.scale.buttons(() => this._paint());
    return element("figcaption", {}, element("b", {}, "Bead in 3-D"), ...colours, ...buttons, this.scale.element);
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
    this.cursor.onMove(() => this._redraw(this.machine.object.visible)); // else only labels move
    this.cursor.onChoice(() => this._redraw());
    onTheme(() => this._paint());
    new ResizeObserver(() => this._resize()).observe(this.surface);
    new IntersectionObserver((entries) => {
      this.inSight = entries[entries.length - 1].isIntersecting;
      this._redraw();
    }).observe(this.surface);
  }

  /** @param {number} row */
  _described(row) {
    const { data } = this;
    const place = ["x", "y", "z"].filter((name) => data.seriesOf(name)).map((name) => `${name} ${data.text(name, row)}`).join(", ");
    const width = data.width ? `, bead width ${data.text("width", row)}` : "";
    return `t = ${data.time[row].toFixed(3)} s, ${place}, contour error ${data.text("contour", row)}${width}`;
  }

  _paint() {
    const colours = theme();
    this.renderer.setClearColor(colours.paper);
    this.ground.paint(colours.line);
    this.machine.paint(colours.soft, colours.ink);
    this.travel.color.set(colours.soft);
    this.shade.color.set(colours.soft);
    this.ribbon.paint(this.scale.painter());
    this.dots.paint(this.scale.painter());
    this.surface.setAttribute("aria-label", `Bead in 3-D, coloured by ${this.scale.quantity}`);
    this._redraw();
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
    this.machine.fade(this.width);
    if (first) this._fit();
    this._redraw();
  }

  /** Show the whole bead from where the camera looks. */
  _fit() {
    this.whole = true; // until it is moved or zoomed
    const { data, frame, factor } = this;
    const { x, y, z } = data.column;
    const every = Math.ceil(this.laid.length / MOST_POINTS);
    const laid = this.laid.filter((_, k) => k % every === 0);
    const { corners, top } = this.ground;
    const { right } = this.camera;
    /** @param {number[]} corner */
    const aside = (corner) => corner[0] * right.x + corner[1] * right.y;
    const left = corners.reduce((first, corner) => (aside(corner) < aside(first) ? corner : first));
    const scale = [left[0], left[1], top]; // of heights, which stands there
    const places = [...laid.map((row) => [x[row], y[row], z[row]]), ...corners, scale];
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
    const { x, y, z } = this.data.column;
    return this.project(x[row], y[row], z[row], result);
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
    const { camera, data } = this;
    if (this.stale) {
      if (this.machine.object.visible) this.machine.pose(data.column.tick[this.cursor.row]);
      camera.place(this.width, this.height, FARTHEST);
      this.renderer.render(this.scene, camera.three);
      this.stale = false;
    }
    const context = this.top.getContext("2d");
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
