// The data of a run as the page holds them: columns of integers in base64, or as bytes, see gantrysim/report/encoding.py.

const MISSING = 65535;
const JUMP = -128;

/** @param {string | Uint8Array} text */
export function bytesOf(text) {
  if (text instanceof Uint8Array) return text;
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let k = 0; k < bytes.length; k++) bytes[k] = binary.charCodeAt(k);
  return bytes;
}

/** A text that is compressed by gzip, in base64. @param {string} text */
export async function expanded(text) {
  const stream = new Blob([/** @type {BlobPart} */ (bytesOf(text))]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).text();
}

/** @param {string | Uint8Array} text */
function wordsOf(text) {
  const bytes = bytesOf(text);
  const words = new Uint16Array(bytes.length / 2);
  for (let k = 0; k < words.length; k++) words[k] = bytes[2 * k] | (bytes[2 * k + 1] << 8);
  return words;
}

/**
 * @param {CodedColumn} column
 * @param {number} rows
 */
function codesOf(column, rows) {
  if (column.kind === "u16") return wordsOf(column.data);
  const codes = new Uint16Array(rows);
  const bytes = bytesOf(column.data);
  const differences = new Int8Array(bytes.buffer, bytes.byteOffset, bytes.length);
  const jumps = wordsOf(column.jumps ?? "");
  let code = 0;
  let jump = 0;
  for (let k = 0; k < rows; k++) {
    code = differences[k] === JUMP ? jumps[jump++] : code + differences[k];
    codes[k] = code;
  }
  return codes;
}

/**
 * Return the values of a column, NaN where there is none.
 *
 * @param {ColumnContent} column
 * @param {number} rows
 */
export function decode(column, rows) {
  const values = new Float64Array(rows);
  if (column.kind === "ascending") {
    const differences = column.data ? wordsOf(column.data) : null;
    values[0] = column.first;
    for (let k = 1; k < rows; k++) values[k] = values[k - 1] + (differences ? differences[k - 1] : 1);
  } else if (column.kind === "runs") {
    let k = 0;
    column.values.forEach((value, run) => {
      values.fill(value, k, k + column.counts[run]);
      k += column.counts[run];
    });
  } else {
    const codes = codesOf(column, rows);
    for (let k = 0; k < rows; k++) {
      values[k] = codes[k] === MISSING ? NaN : column.offset + column.scale * codes[k];
    }
  }
  return values;
}

/**
 * The smallest and largest known value between two rows, [0, 0] where there is none.
 *
 * @param {ArrayLike<number>} values
 * @returns {[number, number]}
 */
export function extent(values, first = 0, last = values.length - 1) {
  let low = Infinity;
  let high = -Infinity;
  for (let k = first; k <= last; k++) {
    if (values[k] < low) low = values[k];
    if (values[k] > high) high = values[k];
  }
  return low <= high ? [low, high] : [0, 0];
}

/**
 * Stretches of rows, [first, last], in which a condition holds.
 *
 * @param {number} rows
 * @param {(row: number) => unknown} holds
 */
export function stretches(rows, holds) {
  /** @type {Stretch[]} */
  const found = [];
  for (let k = 0; k < rows; k++) {
    if (!holds(k)) continue;
    const last = found[found.length - 1];
    if (last && last[1] === k - 1) last[1] = k;
    else found.push([k, k]);
  }
  return found;
}

/** Values for an axis: never falling, and spread evenly over rows that have none. @param {Values} values */
function ascending(values) {
  const known = values.findIndex((value) => !isNaN(value));
  const result = new Float64Array(values.length);
  let last = 0;
  let highest = known < 0 ? 0 : values[known];
  result[0] = highest;
  for (let k = 1; k < values.length; k++) {
    if (isNaN(values[k])) continue;
    const next = Math.max(values[k], highest);
    for (let j = last + 1; j <= k; j++) result[j] = highest + ((next - highest) * (j - last)) / (k - last);
    last = k;
    highest = next;
  }
  return result.fill(highest, last);
}

/** A run: its columns by name, with time [s], and what describes them. */
export class RunData {
  /** @type {number} */ rows;
  /** @type {number} */ ticks;
  /** @type {number} */ start;
  /** @type {number} */ period;
  /** @type {SeriesContent[]} */ series;
  /** @type {[number, number, number][]} */ corners;
  /** @type {Record<string, string> | null} */ program;
  /** @type {number} */ magnification;
  /** @type {boolean} */ passes;
  /** @type {string} */ shown;
  /** @type {number | null} */ width;
  /** @type {number} */ path_tolerance;
  /** @type {number} */ width_tolerance;
  /** @type {SpaceContent | null} */ space;
  /** @type {Solid[][] | null} */ solids;
  /** @type {DotContent[]} */ dots;
  /** @type {Columns} */ column;
  /** @type {Values} */ time;
  /** @type {number} */ end;
  /** @type {Values} the error's size */ size;
  /** @type {Values} */ along;
  /** @type {{ x: number[], y: number[] }} */ requested;
  /** @type {number} */ worst;
  /** @type {string} what is worst there, in words */ worstValue;
  /** @type {Stretch[]} where the dispenser is off */ off;
  /** @type {Stretch[]} where the needle passes through its own glue */ ploughed;
  /** @type {[number, number] | null} lengths at starts and stops over which the width is not judged [mm] */ unjudged_ends;
  /** @type {string} statistic of the path's error that its tolerance bounds */ path_statistic;

  /** @param {RunContent} content */
  constructor(content) {
    this.load(content);
  }

  /**
   * Take over the content of a run, in place of another one's.
   *
   * @param {RunContent} content
   */
  load(content) {
    Object.assign(this, content);
    this.dots = content.dots || [];
    this.column = {};
    for (const name of Object.keys(content.columns)) this.column[name] = decode(content.columns[name], content.rows);
    this.column.z ??= new Float64Array(content.rows); // of a flat run
    const { tick, s, x, y, dx, dy, contour } = this.column;
    const rows = this.rows;
    this.time = tick.map((k) => content.start + k * content.period);
    this.end = content.start + (content.ticks - 1) * content.period;
    this.size = this.column.distance || contour.map(Math.abs);
    this.along = ascending(s);
    this.requested = this._requested(x.map((value, k) => value - dx[k]), y.map((value, k) => value - dy[k]));
    let largest = 0;
    for (let k = 0; k < rows; k++) if (this.size[k] > (this.size[largest] || 0)) largest = k;
    this.worst = content.worst ?? largest; // where the verdict is worst
    this.worstValue = content.worst === null ? "" : content.worst_value;
    this.off = stretches(rows, (k) => !this.column.dispense[k]);
    this.ploughed = this.column.ploughed ? stretches(rows, (k) => this.column.ploughed[k]) : [];
  }

  /**
   * The requested path as a line, NaN where it is interrupted: through the feet of the nozzle, and through the corners
   * between two of them, whose tips the nozzle may not reach.
   *
   * @param {Values} x
   * @param {Values} y
   */
  _requested(x, y) {
    const { s } = this.column;
    /** @type {{ x: number[], y: number[] }} */
    const line = { x: [], y: [] };
    let next = 0;
    for (let row = 0; row < this.rows; row++) {
      for (; next < this.corners.length && this.corners[next][0] < s[row]; next++) {
        const between = row > 0 && this.corners[next][0] > s[row - 1]; // false where glue is interrupted
        if (!between) continue;
        line.x.push(this.corners[next][1]);
        line.y.push(this.corners[next][2]);
      }
      line.x.push(x[row]);
      line.y.push(y[row]);
    }
    return line;
  }

  /** @param {string} name */
  has(name) {
    return this.series.some((series) => series.name === name);
  }

  /** @param {string} name */
  seriesOf(name) {
    return named(this.series, name);
  }

  links() {
    return this.series.filter((series) => series.group === "error");
  }

  /** The row nearest to a time [s]. @param {number} time */
  rowAt(time) {
    return nearest(this.time, time);
  }

  /** The size of the contour error as text with its unit. @param {number} row */
  sizeText(row) {
    const { decimals, unit } = this.seriesOf("contour");
    return `${number(this.size[row], decimals)} ${unit}`;
  }

  /** A value as text with its unit; a dash where there is none. @param {string} name @param {number} row */
  text(name, row) {
    const { decimals, unit } = this.seriesOf(name);
    const value = this.column[name][row];
    return isNaN(value) ? "–" : `${number(value, decimals)} ${unit}`;
  }
}

/**
 * The series of a name that is there for certain.
 *
 * @template {{ name: string }} Series
 * @param {Series[]} series
 * @param {string} name
 */
export function named(series, name) {
  const found = series.find((one) => one.name === name);
  if (!found) throw new Error(`no series ${name}`);
  return found;
}

/** A number as text, with a minus sign and no minus before a zero. @param {number} value @param {number} decimals */
export function number(value, decimals) {
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
}

/** A size in three digits, or as many as it has before its point. @param {number} size */
export function digits(size) {
  const text = size.toPrecision(3);
  return text.includes("e") ? number(size, 0) : text;
}

/**
 * Index of the value nearest to one in ascending values.
 *
 * @param {Values} values
 * @param {number} value
 */
export function nearest(values, value) {
  let low = 0;
  let high = values.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (values[middle] < value) low = middle;
    else high = middle;
  }
  return Math.abs(values[low] - value) <= Math.abs(values[high] - value) ? low : high;
}
