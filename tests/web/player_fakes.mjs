// SPDX-License-Identifier: Apache-2.0
// A page, a worker and a renderer for tests of the player, driven by hand.

/** The clock, frames and timers of a page. Time advances in `run` only. */
export class FakeHost {
  time = 1e12;
  frames = new Map();
  timers = new Map();
  nextId = 1;

  now() {
    return this.time;
  }
  requestFrame(callback) {
    this.frames.set(this.nextId, callback);
    return this.nextId++;
  }
  cancelFrame(id) {
    this.frames.delete(id);
  }
  setTimer(callback, milliseconds) {
    this.timers.set(this.nextId, { callback, at: this.time + milliseconds });
    return this.nextId++;
  }
  clearTimer(id) {
    this.timers.delete(id);
  }

  /** Lets time pass, with 50 frames per second. Events queued meanwhile are dispatched. */
  async run(milliseconds) {
    const end = this.time + milliseconds;
    while (this.time < end) {
      this.time = Math.min(end, this.time + 20);
      for (const [id, { callback, at }] of [...this.timers]) {
        if (at > this.time) continue;
        this.timers.delete(id);
        callback();
      }
      const frames = [...this.frames.values()];
      this.frames.clear();
      for (const frame of frames) frame();
      await settle();
    }
  }
}

/** Lets promises and queued events run. */
export async function settle() {
  for (let i = 0; i < 10; ++i) await Promise.resolve();
}

export const INFO = {
  duration: 10, tickSeconds: 0.04, frames: 250, shDegree: 1, primitives: 1000,
  boundsMin: [-1, -1, -1], boundsMax: [1, 1, 1], up: null, metresPerUnit: null, floor: null, background: [0, 0, 0],
  tierPrimitives: [600, 1000], audio: null,
  startCamera: {
    rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1], translation: [0, 0, 5],
    fx: 500, fy: 500, cx: 320, cy: 180, width: 640, height: 360, near: 0.01,
  },
};

/** Records the messages of the page. The test posts those of the core. */
export class FakeWorker {
  posted = [];
  listeners = { message: [], error: [] };
  terminated = false;
  info = INFO;

  constructor(host) {
    this.host = host;
  }
  postMessage(message) {
    if (this.terminated) throw new Error("the worker is terminated");
    this.posted.push(message);
  }
  addEventListener(type, listener) {
    this.listeners[type].push(listener);
  }
  terminate() {
    this.terminated = true;
  }

  send(message) {
    for (const listener of this.listeners.message) listener({ data: message });
  }
  opened(info = INFO) {
    this.info = info;
    this.send({ type: "opened", info });
  }
  state(state, seconds, more = {}) {
    this.send({
      type: "state", state, seconds, at: this.host.now(), rate: 1, buffered: [[0, 10]],
      seek: this.last("seek")?.id ?? 0, layers: 2, layerCount: 3, bytes: 1000, duration: 10,
      bytesPerSecond: 5000, memory: 2000, live: null, tierPrimitives: this.info.tierPrimitives, ...more,
    });
  }
  segment(id, begin = 0, end = 250) {
    const words = new ArrayBuffer(0);
    this.send({
      type: "segment",
      segment: { id, primitives: 10, shDegree: 0, begin, end, origin: 0, words },
    });
  }
  /** The types of the messages of the page. */
  types() {
    return this.posted.map((message) => message.type);
  }
  last(type) {
    return this.posted.filter((message) => message.type === type).pop();
  }
}

/** Records calls. */
export class FakeRenderer {
  name = "webgl2";
  onError = () => undefined;
  statistics = { primitives: 1000, visible: 800, sortMs: 1.5 };
  frames = []; // { camera, ticks, exact }
  segments = new Set();
  scenes = 0;
  destroyed = false;

  setScene() {
    ++this.scenes;
  }
  addSegment({ id }) {
    this.segments.add(id);
  }
  removeSegment(id) {
    this.segments.delete(id);
  }
  render(camera, ticks) {
    this.frames.push({ camera, ticks, exact: false });
  }
  async renderExactly(camera, ticks) {
    this.frames.push({ camera, ticks, exact: true });
  }
  views = null;
  async readPixels() {
    return new Float32Array(0);
  }
  destroy() {
    this.destroyed = true;
  }
}

export class FakeCanvas extends EventTarget {
  width = 640;
  height = 360;
  toBlob(callback, type) {
    callback(new Blob([`${this.width}x${this.height}`], { type }));
  }
}
