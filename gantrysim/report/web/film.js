// The film and the cursor follow each other. The film lasts the whole run, at an even speed: its first frame shows the
// start, the last one before its end card the end. Until something moves it, it rests there, as that shows the whole bead.

const FRAME = 0.04; // [s] of the film
const CLOSE = 0.5 * FRAME;
const CARD = 1; // how long the end card is shown [s] of the film

export class FilmLink {
  /** Time of the film to which the cursor has sent it. @type {number | undefined} */ sent;

  /** @param {RunData} data @param {Cursor} cursor @param {HTMLVideoElement} video */
  constructor(video, data, cursor) {
    this.video = video;
    this.data = data;
    this.cursor = cursor;
    /** @type {number | null} */
    this.wanted = null;
    this.resting = true;
    const rest = () => {
      if (this.resting && video.duration) this._seek(this.end - 0.5 * FRAME);
    };
    this.ending = new AbortController();
    /** @param {string} name @param {() => void} listener */
    const listen = (name, listener) => video.addEventListener(name, listener, { signal: this.ending.signal });
    listen("loadedmetadata", rest);
    rest();
    listen("play", () => {
      if (this.resting) video.currentTime = 0;
      this.resting = false;
      cursor.pinned = false;
      cursor.held = true;
      this._follow();
    });
    for (const name of ["pause", "ended"]) {
      listen(name, () => {
        cursor.held = false;
      });
    }
    listen("seeked", () => {
      if (this.wanted !== null) this._seek(this.wanted);
      else if (this._external()) {
        this.resting = false;
        this.cursor.set(this._row(), this);
      }
    });
    this.leave = cursor.onMove((row, source) => {
      if (source === this || source === "start") return;
      this.resting = false;
      if (!video.duration) return;
      if (!video.paused) video.pause(); // a click or a key took the cursor
      this._seek(this._time(row));
    });
  }

  /** Let film and cursor go their own ways. */
  remove() {
    this.ending.abort();
    this.leave();
    this.cursor.held = false;
  }

  /** Time of the film at which its end card begins. */
  get end() {
    return this.video.duration - CARD;
  }

  /** Seconds of the run in a second of the film: a whole number, but for the last frame, which comes early. */
  get speed() {
    const speed = (this.data.end - this.data.start) / (this.end - FRAME);
    const whole = Math.max(Math.round(speed), 1);
    return Math.abs(speed / whole - 1) < (2 * FRAME) / this.end ? whole : speed;
  }

  /** The time at which the film shows the frame nearest to a row: the middle of that frame. @param {number} row */
  _time(row) {
    const frame = Math.round((this.data.time[row] - this.data.start) / this.speed / FRAME);
    return Math.min((frame + 0.5) * FRAME, this.end - 0.5 * FRAME);
  }

  /** The row that the present frame shows. */
  _row() {
    const frame = Math.floor(this.video.currentTime / FRAME + 1e-6);
    return this.data.rowAt(Math.min(this.data.start + frame * FRAME * this.speed, this.data.end));
  }

  /** Whether the film stands where the cursor has not sent it: its own controls have. */
  _external() {
    return this.sent === undefined || Math.abs(this.video.currentTime - this.sent) > CLOSE;
  }

  /** Go to a time of the film; while it is on its way only the last wish counts. @param {number} time */
  _seek(time) {
    this.wanted = time;
    if (this.video.seeking) return;
    this.wanted = null;
    if (Math.abs(this.video.currentTime - time) < CLOSE) return;
    this.sent = time;
    this.video.currentTime = time;
  }

  /** Move the cursor with the film while it plays. */
  _follow() {
    if (this.video.paused || this.ending.signal.aborted) return;
    this.sent = undefined;
    this.cursor.set(this._row(), this);
    requestAnimationFrame(() => this._follow());
  }
}
