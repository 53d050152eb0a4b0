// SPDX-License-Identifier: Apache-2.0
// A renderer for tests of the element: a floor of dots, and a ring of blobs that turns with time.

const BLOBS = 400, TICKS_PER_TURN = 360;

export class PatternRenderer {
  name = "webgl2";
  statistics = { primitives: 1284032, visible: 918277, sortMs: 3.4 };
  frames = 0;
  last = null;
  sprites = new Map();

  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
  }

  setScene() {}
  addSegment() {}
  removeSegment() {}
  views = null;
  async readPixels() {
    return new Float32Array(0);
  }
  destroy() {
    this.destroyed = true;
  }

  render(camera, ticks) {
    const { context: c } = this;
    const { width, height } = camera;
    ++this.frames;
    this.last = { camera, ticks };
    const { canvas } = this;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const sky = c.createLinearGradient(0, 0, 0, height);
    sky.addColorStop(0, "#1a2230");
    sky.addColorStop(0.55, "#39424d");
    sky.addColorStop(1, "#5b544c");
    c.fillStyle = sky;
    c.fillRect(0, 0, width, height);
    const blobs = [...this.floor(), ...this.ring(ticks)];
    const projected = blobs.map((blob) => this.project(camera, blob));
    projected.sort((a, b) => b.z - a.z);
    for (const { x, y, z, blob } of projected) {
      if (z <= camera.near) continue;
      const radius = Math.max((camera.fx * blob.radius) / z, 0.5);
      c.drawImage(this.sprite(blob), x - radius, y - radius, 2 * radius, 2 * radius);
    }
  }

  /** An image of a blob, drawn once per hue. */
  sprite({ hue, saturation, light }) {
    const key = Math.round(hue / 5);
    if (this.sprites.has(key)) return this.sprites.get(key);
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = 64;
    const c = canvas.getContext("2d");
    const fill = c.createRadialGradient(32, 32, 0, 32, 32, 32);
    fill.addColorStop(0, `hsla(${5 * key}, ${saturation}%, ${light}%, 0.9)`);
    fill.addColorStop(0.55, `hsla(${5 * key}, ${saturation}%, ${light - 8}%, 0.5)`);
    fill.addColorStop(1, `hsla(${5 * key}, ${saturation}%, ${light - 14}%, 0)`);
    c.fillStyle = fill;
    c.fillRect(0, 0, 64, 64);
    this.sprites.set(key, canvas);
    return canvas;
  }

  async renderExactly(camera, ticks) {
    this.render(camera, ticks);
  }

  project(camera, blob) {
    const [x, y, z] = [0, 1, 2].map(
      (i) => [0, 1, 2].reduce((sum, k) => sum + camera.rotation[3 * i + k] * blob.at[k], 0) +
        camera.translation[i]);
    return { x: (camera.fx * x) / z + camera.cx, y: (camera.fy * y) / z + camera.cy, z, blob };
  }

  floor() {
    const dots = [];
    for (let x = -8; x <= 8; ++x) {
      for (let z = -5; z <= 8; ++z) {
        dots.push({ at: [x * 0.6, 1, z * 0.6], radius: 0.06, hue: 35, saturation: 16, light: 60 });
      }
    }
    return dots;
  }

  ring(ticks) {
    return Array.from({ length: BLOBS }, (_, i) => {
      const angle = (2 * Math.PI * (i * 7)) / BLOBS + (2 * Math.PI * ticks) / TICKS_PER_TURN;
      const around = (2 * Math.PI * i) / BLOBS;
      const r = 1.25 + 0.5 * Math.cos(angle);
      const at = [r * Math.cos(around), 0.35 * Math.sin(around * 3) + 0.5 * Math.sin(angle),
                  r * Math.sin(around)];
      return { at, radius: 0.17, hue: 205 + 45 * Math.sin(around + 1), saturation: 46, light: 58 };
    });
  }
}
