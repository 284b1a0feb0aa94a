// The connection to the server: messages in JSON, and results as bytes of which only what has changed is sent.

const AGAIN = 1000; // after which a lost connection is tried again [ms]

export class Link {
  /** @type {WebSocket} */ socket;

  /**
   * @param {Listeners} listeners functions by the kind of message, with its content; "result" gets head and content, "lost"
   *   nothing
   */
  constructor(listeners) {
    this.listeners = listeners;
    /** @type {any} fields and columns by their names */
    this.content = { columns: {} };
    this._open();
  }

  _open() {
    const address = new URL("/socket", location.href);
    address.protocol = address.protocol.replace("http", "ws");
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.addEventListener("open", () => {
      this.content = { columns: {} };
      this.listeners.found();
    });
    this.socket.addEventListener("message", ({ data }) => this._take(data));
    this.socket.addEventListener("close", () => {
      this.listeners.lost();
      setTimeout(() => this._open(), AGAIN);
    });
  }

  /** Ask the server to do something; nothing is asked of one that is gone. @param {object} order */
  send(order) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(order));
  }

  /** @param {ArrayBuffer | string} data */
  _take(data) {
    if (typeof data !== "string") {
      const { fields, columns, same, ...head } = this._unpack(data);
      this.content = { ...pick(this.content, same.fields), ...fields, columns: { ...pick(this.content.columns, same.columns), ...columns } };
      this.listeners.result(head, this.content, data.byteLength);
      return;
    }
    const { kind, ...content } = JSON.parse(data);
    /** @type {Record<string, (...content: any[]) => void>} */
    const listeners = { ...this.listeners };
    listeners[kind]?.(content);
  }

  /** The header of a message, with the bytes of its columns. @param {ArrayBuffer} data */
  _unpack(data) {
    const length = new DataView(data).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    for (const column of Object.values(header.columns)) {
      for (const name of ["data", "jumps"]) {
        const [offset, size] = column[name] || [0, 0];
        // a column without bytes states that by an empty text, as on the page
        if (name in column) column[name] = size ? new Uint8Array(data, 4 + length + offset, size) : "";
      }
    }
    return header;
  }
}

/** @param {string[]} names @param {Record<string, any>} content */
function pick(content, names) {
  return Object.fromEntries(names.map((name) => [name, content[name]]));
}
