// A page in a notebook: in a frame of its own, so that several on one page share neither styles nor names.

export default {
  /** @param {{ model: { get(name: string): string }, el: HTMLElement }} view */
  render({ model, el }) {
    const frame = document.createElement("iframe");
    frame.title = model.get("title");
    frame.style.cssText = "display: block; width: 100%; height: 700px; border: 0";
    frame.srcdoc = model.get("page");
    /** @type {ResizeObserver | undefined} */
    let observer;
    frame.addEventListener("load", () => {
      const content = frame.contentDocument?.documentElement;
      if (!content) return;
      // as high as its content, which unfolds and gets narrower
      observer = new ResizeObserver(() => (frame.style.height = `${content.offsetHeight}px`));
      observer.observe(content);
    });
    el.append(frame);
    return () => observer?.disconnect();
  },
};
