// The dots of a run as caps on the work.

import { BufferAttribute, BufferGeometry, DoubleSide, Mesh, MeshBasicMaterial } from "three";

const RINGS = 6; // from the foot of a cap to its top
const CORNERS = 24; // of a ring
const EDGE = 0.62; // brightness at the foot of a cap; its top has the colour of the scale

export class Dots {
  /** @param {RunData} data @param {Frame} frame the middle, from which positions are counted [mm] */
  constructor(data, frame) {
    this.dots = data.dots;
    const size = RINGS * CORNERS;
    const places = new Float32Array(3 * size * this.dots.length);
    /** @type {number[]} */
    const faces = [];
    let next = 0;
    this.dots.forEach((dot, number) => {
      const sphere = dot.radius > 0 ? (dot.radius ** 2 + dot.height ** 2) / (2 * dot.height) : 0;
      for (let ring = 0; ring < RINGS; ring++) {
        const reach = dot.radius * Math.cos((0.5 * Math.PI * ring) / (RINGS - 1));
        const high = Math.sqrt(Math.max(sphere ** 2 - reach ** 2, 0)) - (sphere - dot.height);
        for (let corner = 0; corner < CORNERS; corner++) {
          const angle = (2 * Math.PI * corner) / CORNERS;
          places[next++] = dot.x - frame.x + reach * Math.cos(angle);
          places[next++] = dot.y - frame.y + reach * Math.sin(angle);
          places[next++] = dot.z - frame.z + high;
          if (!ring) continue;
          const a = number * size + ring * CORNERS + corner;
          const b = number * size + ring * CORNERS + ((corner + 1) % CORNERS);
          faces.push(a, a - CORNERS, b, b, a - CORNERS, b - CORNERS);
        }
      }
    });
    this.geometry = new BufferGeometry();
    this.geometry.setAttribute("position", new BufferAttribute(places, 3));
    this.colours = new BufferAttribute(new Uint8Array(places.length), 3, true);
    this.geometry.setAttribute("color", this.colours);
    this.geometry.setIndex(faces);
    this.object = new Mesh(this.geometry, new MeshBasicMaterial({ vertexColors: true, side: DoubleSide }));
  }

  /** Colour the dots by a function from a row to [red, green, blue]. @param {(row: number) => Rgb} colourAt */
  paint(colourAt) {
    const { array } = this.colours;
    let place = 0;
    for (const dot of this.dots) {
      const colour = colourAt(dot.row);
      for (let ring = 0; ring < RINGS; ring++) {
        const shade = EDGE + ((1 - EDGE) * ring) / (RINGS - 1);
        for (let corner = 0; corner < CORNERS; corner++) for (const part of colour) array[place++] = shade * part;
      }
    }
    this.colours.needsUpdate = true;
  }
}
