// The text of the program or of the job file: numbered lines, the line at the cursor, and errors in the margin.

import { element, toggle } from "../../report/web/dom.js";

const PAUSE = 250; // in typing, after which a text is sent [ms]

export class Editor {
  /**
   * @param {Record<string, HTMLElement>} places elements for the choice of texts and the editor
   * @param {(kind: string, text: string) => void} changed called with kind and text
   * @param {(line: number) => void} atLine called with the line that is chosen
   */
  constructor(places, changed, atLine) {
    this.places = places;
    this.changed = changed;
    this.atLine = atLine;
    this.kind = "program";
    /** @type {Record<string, string | null>} */
    this.texts = {};
    this.count = 0;
    this.numbers = element("pre", { class: "numbers", "aria-hidden": "true" });
    this.marks = element("div", { class: "marks", "aria-hidden": "true" });
    this.area = element("textarea", { spellcheck: "false", autocomplete: "off", wrap: "off", "aria-label": "Program" });
    this.box = element("div", { class: "text" }, element("div", { class: "gutter" }, this.numbers), this.marks, this.area);
    places.editor.append(this.box);
    this.area.addEventListener("input", () => this._typed());
    this.area.addEventListener("scroll", () => this._scrolled());
    for (const name of ["click", "keyup"]) this.area.addEventListener(name, () => this._caret());
    this.timer = 0;
    this.current = 0;
    this.error = null;
  }

  /**
   * Take over the texts of a job: of its program, null where it has none, and of its job file, likewise.
   *
   * @param {Texts} texts
   */
  show({ program, job }) {
    this.texts = { program, job };
    if (this.texts[this.kind] == null) this.kind = program == null ? "job" : "program";
    this._choices();
    this._take();
  }

  _choices() {
    /** @type {Record<string, string>} */
    const labels = { program: "Program", job: "Job file" };
    const kinds = Object.keys(labels).filter((kind) => this.texts[kind] != null);
    const buttons = kinds.map((kind) =>
      toggle(labels[kind], kind === this.kind, () => {
        this.kind = kind;
        this._choices();
        this._take(true);
      }),
    );
    this.places.choices.replaceChildren(...(buttons.length > 1 ? buttons : []));
    this.places.title.textContent = labels[this.kind];
    this.area.setAttribute("aria-label", labels[this.kind]);
  }

  /** Put the text into the editor, unless it is just being typed. */
  _take(other = false) {
    const text = this.texts[this.kind] ?? "";
    if (this.timer || (this.area.value === text && !other)) return;
    const { selectionStart, scrollTop } = this.area;
    this.area.value = text;
    if (!other) this.area.setSelectionRange(selectionStart, selectionStart);
    this.area.scrollTop = other ? 0 : scrollTop;
    this._number();
  }

  _typed() {
    this._number();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.timer = 0;
      this.texts[this.kind] = this.area.value;
      this.changed(this.kind, this.area.value);
    }, PAUSE);
  }

  _number() {
    const count = this.area.value.split("\n").length;
    if (count !== this.count) this.numbers.textContent = Array.from({ length: count }, (value, k) => k + 1).join("\n");
    this.count = count;
    this._mark();
  }

  _scrolled() {
    const { scrollTop, scrollLeft } = this.area;
    this.numbers.style.transform = `translateY(${-scrollTop}px)`;
    this.marks.style.transform = `translate(${-scrollLeft}px, ${-scrollTop}px)`;
  }

  get _height() {
    return parseFloat(getComputedStyle(this.area).lineHeight);
  }

  _caret() {
    if (this.kind !== "program") return;
    this.atLine(this.area.value.slice(0, this.area.selectionStart).split("\n").length);
  }

  /** Mark the line of the program at the cursor, and scroll to it unless one is typing. @param {number} line */
  setLine(line) {
    if (line === this.current) return;
    this.current = line;
    this._mark();
    if (!line || this.kind !== "program" || document.activeElement === this.area) return;
    const top = (line - 1) * this._height;
    const { scrollTop, clientHeight } = this.area;
    if (top < scrollTop || top > scrollTop + clientHeight - 2 * this._height) this.area.scrollTop = top - clientHeight / 2;
  }

  /**
   * Mark what is refused, or nothing; a program's lines are those of the program, else those of the job file.
   *
   * @param {Refusal | null} error
   */
  setError(error) {
    this.error = error;
    this._mark();
    this.area.setAttribute("aria-invalid", String(Boolean(error && error.line)));
  }

  _mark() {
    /** @type {HTMLElement[]} */
    const marks = [];
    const height = this._height;
    /** @param {number} line @param {string} kind */
    const at = (line, kind, attributes = {}) => {
      const mark = element("div", { class: kind, ...attributes });
      mark.style.top = `${(line - 1) * height}px`;
      mark.style.height = `${height}px`;
      marks.push(mark);
      return mark;
    };
    if (this.current && this.kind === "program") at(this.current, "current");
    if (this.error?.line) {
      at(this.error.line, "error", { "data-line": this.error.line, title: this.error.text });
      const text = this.area.value.split("\n")[this.error.line - 1] || "";
      const column = this.error.word ? text.indexOf(this.error.word) : -1;
      if (column >= 0) {
        const word = at(this.error.line, "word", { "data-word": this.error.word });
        word.style.left = `${column}ch`;
        word.style.width = `${this.error.word.length}ch`;
      }
    }
    this.marks.replaceChildren(...marks);
    this.numbers.dataset.error = String(this.error?.line || "");
    this._scrolled();
  }
}
