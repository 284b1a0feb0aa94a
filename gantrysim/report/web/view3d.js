// The 3-D view of a run's bead: coloured by its error or its width, with the machine.

import { element, toggle } from "./dom.js";
import { Dots } from "./dots3d.js";
import { RunLabels } from "./labels3d.js";
import { MachineOutline } from "./machine3d.js";
import { Ribbon } from "./ribbon3d.js";
import { Scale3d } from "./scale3d.js";
import { Scene3d } from "./scene3d.js";
import { theme } from "./theme.js";

/** @extends {Scene3d<RunData>} */
export class View extends Scene3d {
  _labels() {
    return new RunLabels(this);
  }

  _beads() {
    const { x, y, z, dispense } = this.data.column;
    const all = [...x.keys()];
    const laid = all.filter((row) => dispense[row]);
    const points = (laid.length ? laid : all).map((row) => [x[row], y[row], z[row]]); // a dry run's path
    const lowest = points.reduce((low, point) => Math.min(low, point[2]), Infinity);
    return { points, low: lowest - (this.data.space?.gap ?? 0) };
  }

  _build() {
    super._build();
    const { data, frame } = this;
    this.scale ??= new Scale3d(data);
    this.scale.update();
    const isShown = this.machine?.object.visible ?? true;
    this.ribbon = new Ribbon(data, frame, this.size);
    this.dots = new Dots(data, frame);
    this.machine = new MachineOutline(data, frame);
    this.machine.object.visible = isShown;
    if (this.width) this.machine.fade(this.width);
    const { z } = data.column;
    const travel = this._lines(data, (row) => !data.column.dispense[row], (row) => z[row], this.travel);
    const shade = this._lines(data, (row) => data.column.dispense[row], () => this.ground.z, this.shade);
    const { ploughed } = data.column;
    const passes = this._lines(data, (row) => ploughed?.[row] && ploughed[row - 1], (row) => z[row], this.alarm);
    this.root.add(passes, shade, travel, this.ribbon.object, this.dots.object, this.machine.object);
  }

  _caption() {
    const machine = toggle("machine", true, (on) => {
      if (this.machine) this.machine.object.visible = on;
      this._redraw();
    });
    const colours = this.scale?.buttons(() => this._paint()) ?? [];
    const bar = this.scale ? [this.scale.element] : [];
    return element("figcaption", {}, element("b", {}, "Bead in 3-D"), ...colours, machine, ...this._looks(), ...bar);
  }

  _paint() {
    const { scale } = this;
    const { soft, ink } = theme();
    if (scale) {
      this.machine?.paint(soft, ink);
      this.ribbon?.paint(scale.painter());
      this.dots?.paint(scale.painter());
      this.surface.setAttribute("aria-label", `Bead in 3-D, coloured by ${scale.quantity}`);
    }
    super._paint();
  }

  _resize() {
    super._resize();
    this.machine?.fade(this.width);
  }

  get _moves() {
    return Boolean(this.machine?.object.visible);
  }

  _pose() {
    if (this.machine?.object.visible) this.machine.pose(this.data.column.tick[this.cursor.row]);
  }

  /** @param {number} row */
  pointAt(row) {
    const { x, y, z } = this.data.column;
    return [x[row], y[row], z[row]];
  }

  /** @param {number} row */
  _described(row) {
    const { data } = this;
    const place = ["x", "y", "z"].filter((name) => data.has(name)).map((name) => `${name} ${data.text(name, row)}`).join(", ");
    const width = data.width ? `, bead width ${data.text("width", row)}` : "";
    return `t = ${data.time[row].toFixed(3)} s, ${place}, contour error ${data.text("contour", row)}${width}`;
  }
}
