// The film and the cursor follow each other. The film lasts the whole run, at an even speed.

const CLOSE = 0.02; // [s] of the film, less than a frame

export class FilmLink {
  constructor(video, data, cursor) {
    this.video = video;
    this.data = data;
    this.cursor = cursor;
    this.wanted = null;
    video.addEventListener("play", () => {
      cursor.pinned = false;
      cursor.held = true;
      this._follow();
    });
    for (const name of ["pause", "ended"]) {
      video.addEventListener(name, () => {
        cursor.held = false;
      });
    }
    video.addEventListener("seeked", () => {
      if (this.wanted !== null) this._seek(this.wanted);
      else if (this._external()) this.cursor.set(this._row(), this);
    });
    cursor.onMove((row, source) => {
      if (source === this || !video.duration) return;
      if (!video.paused) video.pause(); // a click or a key took the cursor
      this._seek(this._time(row));
    });
  }

  /** Seconds of the run in a second of the film. */
  get speed() {
    return (this.data.end - this.data.start) / this.video.duration;
  }

  _time(row) {
    return (this.data.time[row] - this.data.start) / this.speed;
  }

  _row() {
    return this.data.rowAt(this.data.start + this.video.currentTime * this.speed);
  }

  /** Whether the film stands where the cursor has not sent it: its own controls have. */
  _external() {
    return this.sent === undefined || Math.abs(this.video.currentTime - this.sent) > CLOSE;
  }

  /** Go to a time of the film; while it is on its way only the last wish counts. */
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
    if (this.video.paused) return;
    this.sent = undefined;
    this.cursor.set(this._row(), this);
    requestAnimationFrame(() => this._follow());
  }
}
