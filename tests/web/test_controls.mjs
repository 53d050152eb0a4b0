// SPDX-License-Identifier: Apache-2.0
// Keys and texts of the controls.
import assert from "node:assert/strict";
import { test } from "node:test";
import { importSource } from "./import_source.mjs";

const text = await importSource("src/element/text.ts");
const keyboard = await importSource("src/element/keyboard.ts");
const key = (name, more = {}) =>
  ({ key: name, shiftKey: false, ctrlKey: false, altKey: false, metaKey: false, ...more });

test("times suit the duration", () => {
  assert.equal(text.formatTime(3.27, 12), "0:03.2");
  assert.equal(text.formatTime(0.3, 12), "0:00.3");
  assert.equal(text.formatTime(59.999, 75), "0:59");
  assert.equal(text.formatTime(75, 75), "1:15");
  assert.equal(text.formatTime(61, 4000), "0:01:01");
  assert.equal(text.formatTime(3725, 4000), "1:02:05");
  assert.equal(text.formatTime(NaN, 10), "0:00");
  assert.equal(text.formatTime(0, 0), "0:00");
});

test("spoken times have correct plurals", () => {
  assert.equal(text.speakTime(1), "1 second");
  assert.equal(text.speakTime(0.5), "0.5 seconds");
  assert.equal(text.speakTime(61), "1 minute 1 second");
  assert.equal(text.speakTime(119.99), "2 minutes 0 seconds");
});

test("bytes have three significant digits at most", () => {
  assert.equal(text.formatBytes(0), "0 B");
  assert.equal(text.formatBytes(999), "999 B");
  assert.equal(text.formatBytes(999999), "1.0 MB");
  assert.equal(text.formatBytes(50.4e6), "50.4 MB");
  assert.equal(text.formatBytes(504e6), "504 MB");
});

test("the name of the renderer points out blending in 8 bits", () => {
  assert.equal(text.formatRenderer(null, {}), "–");
  assert.equal(text.formatRenderer("webgpu", {}), "WebGPU");
  assert.equal(text.formatRenderer("webgl2", { targetFormat: "rgba16f" }), "WebGL2");
  assert.equal(text.formatRenderer("webgl2", { targetFormat: "rgba8" }), "WebGL2, 8-bit blending");
});

test("rates step through the menu from any rate", () => {
  assert.equal(keyboard.nextRate(1, 1), 1.5);
  assert.equal(keyboard.nextRate(1, -1), 0.75);
  assert.equal(keyboard.nextRate(1.2, -1), 1);
  assert.equal(keyboard.nextRate(2, 1), 2);
  assert.equal(keyboard.nextRate(3, 1), 3);
  assert.equal(keyboard.nextRate(-1, -1), -1);
});

test("arrow keys seek a tenth of the clip, at most 5 s", () => {
  assert.equal(keyboard.seekStep(0.7), 0.06999999999999999);
  assert.equal(keyboard.seekStep(600), 5);
});

test("the seek slider has the keys of a slider", () => {
  const time = (name, more) => keyboard.sliderTime(key(name, more), 50, 200);
  assert.deepEqual(["ArrowLeft", "ArrowDown", "PageDown", "Home"].map((name) => time(name)), [45, 45, 30, 0]);
  assert.deepEqual(["ArrowRight", "ArrowUp", "PageUp", "End"].map((name) => time(name)), [55, 55, 70, 200]);
  assert.equal(keyboard.sliderTime(key("PageUp"), 195, 200), 200);
  assert.equal(time("ArrowUp", { shiftKey: true }), null); // rotates
  assert.equal(time(" "), null);
});

test("keys with modifiers stay with the browser", () => {
  assert.deepEqual(keyboard.playbackKey(key("K")), { type: "toggle" });
  assert.equal(keyboard.playbackKey(key("f", { ctrlKey: true })), null);
  assert.equal(keyboard.playbackKey(key("ArrowLeft", { altKey: true })), null);
  assert.equal(keyboard.cameraKey(key("r", { metaKey: true })), null);
});

test("shift and an arrow key rotate and do not seek", () => {
  const input = key("ArrowLeft", { shiftKey: true });
  assert.equal(keyboard.playbackKey(input), null);
  assert.equal(keyboard.cameraKey(input).type, "rotate");
});
