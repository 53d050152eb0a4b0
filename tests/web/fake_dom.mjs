// SPDX-License-Identifier: Apache-2.0
// The part of the DOM that <stgs-player> uses, for node: attributes, children and events that do not bubble.
// Importing it sets the globals of a page.

class FakeElement extends EventTarget {
  attributes = new Map();
  children = [];
  dataset = {};
  classes = new Set();
  style = { setProperty: () => undefined };
  hidden = false;
  isConnected = false;
  clientWidth = 640;
  clientHeight = 360;
  offsetWidth = 0;
  text = "";
  ownerDocument = { defaultView: globalThis };
  classList = {
    toggle: (name, isSet) => void (isSet ? this.classes.add(name) : this.classes.delete(name)),
    add: (name) => void this.classes.add(name),
    remove: (name) => void this.classes.delete(name),
    contains: (name) => this.classes.has(name),
  };

  get textContent() {
    return this.text + this.children.map((child) => child.textContent ?? child).join("");
  }
  set textContent(text) {
    this.text = text;
    this.children = [];
  }

  getAttribute(name) {
    return this.attributes.get(name) ?? null;
  }
  hasAttribute(name) {
    return this.attributes.has(name);
  }
  setAttribute(name, value) {
    if (name === "class") String(value).split(" ").forEach((one) => this.classes.add(one));
    this.change(name, String(value));
  }
  removeAttribute(name) {
    if (this.attributes.has(name)) this.change(name, null);
  }
  toggleAttribute(name, isSet) {
    if (isSet) this.setAttribute(name, "");
    else this.removeAttribute(name);
  }
  change(name, value) {
    const old = this.getAttribute(name);
    if (value === null) this.attributes.delete(name);
    else this.attributes.set(name, value);
    if (this.constructor.observedAttributes?.includes(name)) this.attributeChangedCallback(name, old, value);
  }

  append(...children) {
    this.children.push(...children);
  }
  replaceChildren(...children) {
    this.children = children;
  }
  attachShadow() {
    return (this.shadowRoot = new FakeElement());
  }
  querySelector() {
    return null;
  }
  matches() {
    return false;
  }
  focus() {}

  /** Finds the first descendant of this class. */
  find(name) {
    for (const child of [...(this.shadowRoot?.children ?? []), ...this.children]) {
      if (!(child instanceof FakeElement)) continue;
      const found = child.classes.has(name) ? child : child.find(name);
      if (found !== null) return found;
    }
    return null;
  }

  /** Connects or disconnects a custom element. */
  connect() {
    this.isConnected = true;
    this.connectedCallback();
  }
  remove() {
    this.isConnected = false;
    this.disconnectedCallback();
  }
}

const page = new EventTarget();
const defined = new Map();
Object.assign(globalThis, {
  window: Object.assign(page, { devicePixelRatio: 1, setTimeout, clearTimeout, setInterval, clearInterval }),
  document: Object.assign(new EventTarget(), {
    createElement: () => new FakeElement(), createElementNS: () => new FakeElement(),
    fullscreenEnabled: false, baseURI: "https://page.example/",
  }),
  customElements: { define: (name, type) => defined.set(name, type), get: (name) => defined.get(name) },
  HTMLElement: FakeElement,
  HTMLButtonElement: class {},
  CSSStyleSheet: class {
    replaceSync() {}
  },
  ResizeObserver: class {
    observe() {}
    unobserve() {}
  },
  matchMedia: () => ({ matches: false }),
  frames: 0, // requested
  requestAnimationFrame: (callback) => (++globalThis.frames, setTimeout(callback, 1).unref()),
  cancelAnimationFrame: clearTimeout,
});
