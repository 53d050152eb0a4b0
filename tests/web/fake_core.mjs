// SPDX-License-Identifier: Apache-2.0
// A core for tests of the element: plays a clip of 12 s that is fetched in 1.5 s, or a recording with
// its live edge there.

const DURATION = 12, TICK = 1 / 30, LAST = DURATION - TICK, FETCH_RATE = 8;
const TIERS = [500000, 900000, 1284032]; // primitives
const now = () => performance.timeOrigin + performance.now();

export class FakeCore {
  posted = [];
  seconds = 0;
  rate = 1;
  loop = false;
  plays = false;
  lastSeek = 0;
  fetched = 0.5;
  live = null;
  listener = null;
  timer = null;

  addEventListener(type, listener) {
    if (type === "message") this.listener = listener;
  }

  postMessage(message) {
    this.posted.push(message);
    setTimeout(() => this.handle(message), 2);
  }

  terminate() {
    clearInterval(this.timer);
    this.listener = null;
  }

  send(message) {
    this.listener?.({ data: message });
  }

  handle(message) {
    switch (message.type) {
      case "open":
        return this.open(message.source);
      case "play":
        if (this.seconds >= LAST) this.seconds = 0;
        this.plays = true;
        break;
      case "pause":
        this.plays = false;
        this.follow(false);
        break;
      case "seek":
        this.follow(message.seconds >= LAST);
        this.seconds = Math.min(message.seconds, this.last);
        this.lastSeek = message.id;
        break;
      case "rate":
        this.rate = message.rate;
        break;
      case "loop":
        this.loop = message.loop;
        break;
      case "close":
        return this.terminate();
    }
    this.report();
  }

  /** The last time to play, or that at the live edge. */
  get last() {
    return this.live === null ? LAST : LAST - 1;
  }

  follow(following) {
    if (this.live !== null) this.live = { following, latency: following ? 1 : 6, targetLatency: 1 };
  }

  open(source) {
    if (String(source).includes("missing")) {
      const message = `${source}: the server reports 404 (Not Found); check the address`;
      return this.send({ type: "error", code: "network", message });
    }
    if (String(source).includes("slow")) return;
    if (String(source).includes("live")) this.live = { following: true, latency: 1, targetLatency: 1 };
    this.send({
      type: "opened",
      info: {
        duration: DURATION, tickSeconds: TICK, frames: 360, shDegree: 1, primitives: 1284032,
        boundsMin: [-2, -1, -2], boundsMax: [2, 1, 2], up: null, background: [0, 0, 0],
        tierPrimitives: TIERS, audio: null,
        startCamera: {
          rotation: [1, 0, 0, 0, 0.97, 0.243, 0, -0.243, 0.97], translation: [0, 0.2, 5.4],
          fx: 1100, fy: 1100, cx: 640, cy: 360, width: 1280, height: 720, near: 0.05,
        },
      },
    });
    const words = new ArrayBuffer(0);
    this.send({
      type: "segment",
      segment: { id: 1, primitives: 9, shDegree: 0, begin: 0, end: 360, origin: 0, words },
    });
    this.timer = setInterval(() => this.advance(0.1), 100);
    this.report();
  }

  advance(passed) {
    this.fetched = Math.min(DURATION, this.fetched + FETCH_RATE * passed);
    if (this.plays) this.seconds = this.next(this.seconds + passed * this.rate);
    this.report();
  }

  next(seconds) {
    return this.loop ? seconds % DURATION : Math.min(seconds, this.last);
  }

  report() {
    const isBuffered = this.seconds <= this.fetched;
    const isEnded = this.plays && !this.loop && this.seconds >= LAST;
    let state = this.plays ? "playing" : "paused";
    if (!isBuffered) state = "buffering";
    else if (isEnded) state = "ended";
    this.plays &&= !isEnded;
    this.send({
      type: "state", state, seconds: this.seconds, seek: this.lastSeek, at: now(), rate: this.rate,
      buffered: [[0, this.fetched]], layers: 2, layerCount: 3, bytes: 4.2e6 * this.fetched, bytesPerSecond: 3.1e6,
      memory: 2.5e8, tierPrimitives: TIERS, duration: DURATION, live: this.live,
    });
  }
}
