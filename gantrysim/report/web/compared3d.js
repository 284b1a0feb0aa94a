// The 3-D view of several runs over one another: their beads in the runs' colours, without their machines.

import { Color } from "three";
import { Labels } from "./labels3d.js";
import { Ribbon } from "./ribbon3d.js";
import { Scene3d } from "./scene3d.js";
import { colourOf, theme } from "./theme.js";

/** @extends {Scene3d<ComparedData>} */
export class ComparedView extends Scene3d {
  _labels() {
    return new Labels(this);
  }

  _beads() {
    const { data } = this;
    const beads = data.runs.map((run, k) => data.beadOf(k));
    const points = beads.flatMap(({ column: { x, y, z } }) =>
      [...x.keys()].filter((row) => x[row] === x[row]).map((row) => [x[row], y[row], z[row]]),
    );
    const low = beads.reduce((least, { column: { x, z }, space }) => {
      const heights = z.filter((value, row) => x[row] === x[row]);
      return Math.min(least, heights.reduce((lowest, value) => Math.min(lowest, value), Infinity) - (space?.gap ?? 0));
    }, Infinity);
    return { points, low };
  }

  _build() {
    super._build();
    const { data, frame } = this;
    this.ribbons = data.drawn.map((run) => {
      const bead = data.beadOf(run);
      const shade = this._lines(bead, () => true, () => this.ground.z, this.shade);
      const ribbon = new Ribbon(bead, frame, this.size);
      // a later run hides those before where they coincide: what is seen of these lies elsewhere
      Object.assign(ribbon.object.material, { polygonOffset: true, polygonOffsetFactor: -run, polygonOffsetUnits: -4 * run });
      this.root.add(shade, ribbon.object);
      return { run, ribbon };
    });
  }

  _paint() {
    for (const { run, ribbon } of this.ribbons ?? []) {
      const { r, g, b } = new Color(colourOf(this.data.runs[run], theme()));
      const colour = [255 * r, 255 * g, 255 * b];
      ribbon.paint(() => colour);
    }
    this.surface.setAttribute("aria-label", "Beads of the runs over one another in 3-D");
    super._paint();
  }

  /** On the first of the runs drawn that has a value there. @param {number} row */
  pointAt(row) {
    const [first] = this.marksAt(row);
    return first ? [first.x, first.y, first.z] : [NaN, NaN, NaN];
  }

  /** @param {number} row */
  marksAt(row) {
    const { column, runs, drawn } = this.data;
    return drawn
      .map((run) => {
        const [x, y, z] = ["x", "y", "z"].map((name) => column[`${name}.${run}`]?.[row] ?? 0);
        return { x, y, z, colour: runs[run].colour };
      })
      .filter(({ x }) => x === x);
  }

  /** @param {number} row */
  _described(row) {
    return this.data.described(row);
  }
}
