// SPDX-License-Identifier: Apache-2.0
// Sound follows the time of the scene, and only permitted locations are loaded.
import assert from "node:assert/strict";
import { test } from "node:test";
import { importSource } from "./import_source.mjs";
import { FakeHost, INFO, settle } from "./player_fakes.mjs";
import { setUp } from "./player_setup.mjs";

const { AudioTrack } = await importSource("src/audio/audio_track.ts");
const { soundUrl } = await importSource("src/audio/location.ts");

/** A sound of 8 s by the clock of a host. `speed`: of its own clock; `latency`: milliseconds of a seek. */
class FakeSound extends EventTarget {
  duration = 8;
  paused = true;
  seeking = false;
  readyState = 4;
  error = null;
  volume = 1;
  muted = false;
  rate = 1;
  allows = true; // play() without a gesture
  seeks = [];
  played = 0;
  base = 0;

  constructor(host, { speed = 1, latency = 0 } = {}) {
    super();
    Object.assign(this, { host, speed, latency, since: host.now() });
  }
  get advances() {
    return !this.paused && !this.seeking && this.readyState >= 3;
  }
  get currentTime() {
    const passed = this.advances ? (this.host.now() - this.since) / 1000 : 0;
    return Math.min(this.base + passed * this.rate * this.speed, this.duration);
  }
  set currentTime(seconds) {
    this.seeks.push(seconds);
    this.hold(seconds);
    if (this.latency === 0) return;
    this.seeking = true;
    this.host.setTimer(() => {
      this.hold(this.base);
      this.seeking = false;
      this.dispatchEvent(new Event("seeked"));
    }, this.latency);
  }
  get playbackRate() {
    return this.rate;
  }
  set playbackRate(rate) {
    this.hold(this.currentTime);
    this.rate = rate;
  }
  hold(seconds) {
    this.base = seconds;
    this.since = this.host.now();
  }
  async play() {
    if (!this.allows && !this.muted) throw new DOMException("no gesture", "NotAllowedError");
    this.hold(this.currentTime);
    this.paused = false;
    ++this.played;
  }
  pause() {
    this.hold(this.currentTime);
    this.paused = true;
  }
  removeAttribute() {}
  load() {}
}

/** A track whose scene plays from `seconds` on. */
function follow({ begin = 0, seconds = 0, rate = 1, ...options } = {}) {
  const host = new FakeHost();
  const sound = new FakeSound(host, options);
  const scene = { base: seconds, since: host.now(), rate, running: true };
  const time = () => scene.base + (scene.running ? (scene.rate * (host.now() - scene.since)) / 1000 : 0);
  const reports = [];
  const track = new AudioTrack(
    sound, begin, { time: () => ({ seconds: time(), running: scene.running }), rate: () => scene.rate }, host,
    { ready: () => reports.push("ready"), blocked: () => reports.push("blocked"), failed: (why) => reports.push(why) });
  const move = (change) => {
    Object.assign(scene, { base: time(), since: host.now() }, change);
    track.update();
  };
  track.update();
  return { host, sound, track, reports, move, drift: () => sound.currentTime - (time() - begin) };
}

test("sound starts with the scene, and pauses with it", async () => {
  const { host, sound, move, drift } = follow({ seconds: 2 });
  await host.run(1000);
  assert.ok(!sound.paused && Math.abs(drift()) < 0.02);
  move({ running: false }); // a pause, or a stall
  await host.run(500);
  assert.ok(sound.paused && Math.abs(drift()) < 0.03);
  move({ running: true });
  await host.run(500);
  assert.ok(!sound.paused && Math.abs(drift()) < 0.03);
  assert.deepEqual(sound.seeks, [2]);
});

test("a drift stays bounded, without seeks", async () => {
  for (const speed of [0.97, 1.03]) {
    const { host, sound, drift } = follow({ speed });
    let worst = 0;
    for (let k = 0; k < 70; ++k) {
      await host.run(100);
      worst = Math.max(worst, Math.abs(drift()));
    }
    assert.ok(worst < 0.1, `${worst} s at ${speed}`);
    assert.equal(sound.seeks.length, 0);
  }
});

test("a seek of the scene seeks the sound, also if that takes long", async () => {
  const { host, sound, move, drift } = follow({ latency: 600 });
  await host.run(1000);
  move({ base: 4 });
  await host.run(3000);
  assert.ok(Math.abs(drift()) < 0.1, `${drift()} s`);
  const { length } = sound.seeks;
  assert.ok(length >= 1 && length <= 3, `${length} seeks`);
  move({ base: 0.5 }); // as when it loops
  await host.run(3000);
  assert.ok(Math.abs(drift()) < 0.1, `${drift()} s`);
  assert.ok(sound.seeks.length <= length + 2);
});

test("the beginning of the sound is a time of the scene", async () => {
  const late = follow({ begin: 0.5 });
  await late.host.run(440);
  assert.ok(late.sound.paused);
  await late.host.run(200);
  assert.ok(!late.sound.paused && Math.abs(late.drift()) < 0.06, `${late.drift()} s`);
  const early = follow({ begin: -3 });
  assert.deepEqual(early.sound.seeks, [3]);
  await early.host.run(6000);
  assert.ok(early.sound.paused); // its 8 s are over
});

test("rates apply to the sound, and it is silent at rates that browsers do not play", async () => {
  const { host, sound, move, drift } = follow({ rate: 2 });
  await host.run(1000);
  assert.ok(Math.abs(sound.playbackRate - 2) < 0.13 && Math.abs(drift()) < 0.05);
  move({ rate: -1 });
  await host.run(300);
  assert.ok(sound.paused);
  move({ rate: 0.1 });
  assert.ok(sound.paused);
  move({ rate: 1 });
  await host.run(300);
  assert.ok(!sound.paused && Math.abs(drift()) < 0.05);
});

test("a browser that needs a gesture plays muted, and that is reported", async () => {
  const { host, sound, track, reports, move } = follow();
  sound.allows = false;
  move({ running: false });
  await host.run(100);
  move({ running: true });
  await host.run(300);
  assert.deepEqual(reports, ["blocked"]);
  assert.ok(!sound.paused && sound.muted);
  track.setVolume(0.5, false); // a click
  assert.deepEqual([sound.muted, sound.volume], [false, 0.5]);
});

test("a browser that does not even play muted sound is asked again", async () => {
  const { host, sound, reports, move } = follow();
  sound.play = async () => {
    throw new DOMException("no gesture", "NotAllowedError");
  };
  move({ running: false });
  move({ running: true });
  await host.run(700);
  assert.deepEqual([reports, sound.paused], [["blocked"], true]);
  delete sound.play;
  await host.run(300);
  assert.deepEqual([reports, sound.paused], [["blocked"], false]);
});

test("a sound that stalls catches up, and one that fails is reported once", async () => {
  const { host, sound, track, reports, drift } = follow();
  await host.run(500);
  sound.hold(sound.currentTime);
  sound.readyState = 2;
  await host.run(1000);
  assert.equal(sound.seeks.length, 0);
  sound.readyState = 4;
  sound.hold(sound.base);
  await host.run(1000);
  assert.ok(Math.abs(drift()) < 0.1);
  sound.error = { message: "cannot be decoded" };
  sound.dispatchEvent(new Event("error"));
  sound.dispatchEvent(new Event("error"));
  track.update();
  assert.deepEqual(reports, ["the sound cannot be played: cannot be decoded"]);
  assert.ok(sound.paused && host.timers.size === 0);
});

test("only locations on the server of the file are followed", () => {
  const base = "https://host.example/scenes/a.stgs?key=1";
  const url = (location, from = base) => soundUrl({ location, base: from, begin: 0 }).href;
  assert.equal(url("a.m4a"), "https://host.example/scenes/a.m4a");
  assert.equal(url("../b%20c.ogg?x#t=1"), "https://host.example/b%20c.ogg?x#t=1");
  assert.equal(url("/a.wav"), "https://host.example/a.wav");
  assert.equal(url("https://host.example:443/a.wav"), "https://host.example/a.wav");
  for (const location of [
    "https://other.example/a.wav", "//other.example/a.wav", "http://host.example/a.wav", "\\\\other.example\\a.wav",
    "https://host.example:8443/a.wav", "data:audio/wav,x", "blob:https://host.example/1", "file:///etc/passwd",
    "javascript:alert(1)", "https://user@host.example/a.wav", "https://[", `https://other.example/${"x".repeat(9999)}`,
  ]) assert.throws(() => url(location), (error) => /is not played/.test(error.message) && error.message.length < 400);
  for (const from of ["", "blob:https://host.example/1", "file:///a.stgs"])
    assert.throws(() => url("a.wav", from), /not from a server/);
});

/** Opens a scene with a sound on a page of `origin`; returns the player, its sounds and its requests. */
async function openWithSound(t, { scene = "http://page/scene.stgs", location = "a.wav", reply, set = () => {}, opened = () => {} } = {}) {
  const parts = setUp(), sounds = [], requests = [], notices = [], events = [];
  const globals = {
    location: { origin: "http://page" },
    Audio: function () {
      sounds.push(new FakeSound(parts.host));
      sounds[sounds.length - 1].readyState = 0;
      return sounds[sounds.length - 1];
    },
    fetch: async (url, options) => {
      requests.push({ url, ...options });
      return reply ?? { ok: true, status: 200, url };
    },
  };
  const before = Object.fromEntries(Object.keys(globals).map((name) => [name, globalThis[name]]));
  Object.assign(globalThis, globals);
  t.after(() => Object.assign(globalThis, before));
  const { player, worker } = parts;
  player.addEventListener("notice", ({ detail }) => notices.push(detail));
  for (const name of ["audiochange", "volumechange"]) player.addEventListener(name, () => events.push(name));
  set(player);
  player.src = scene;
  worker.opened({ ...INFO, audio: { location, begin: 0, base: scene } });
  opened(player);
  worker.segment(1);
  worker.state("paused", 0);
  await parts.host.run(100);
  const [sound] = sounds;
  if (sound?.src) {
    sound.readyState = 4;
    sound.dispatchEvent(new Event("loadedmetadata"));
    await settle();
  }
  return { ...parts, sound, sounds, requests, notices, events };
}

test("a player plays the sound of its file", async (t) => {
  const { player, worker, host, sound, requests, events } = await openWithSound(t);
  const [{ url, method, headers, mode }] = requests;
  assert.deepEqual([url, method, headers.Range, mode], ["http://page/a.wav", undefined, "bytes=0-0", "same-origin"]);
  assert.deepEqual([sound.src, player.hasAudio, events], ["http://page/a.wav", true, ["audiochange"]]);
  player.volume = 0.25;
  player.muted = true;
  await settle();
  assert.deepEqual([sound.volume, sound.muted, events.length], [0.25, true, 3]);
  assert.throws(() => (player.volume = 1.5), { name: "IndexSizeError" });
  player.play().catch(() => undefined);
  worker.state("playing", 0);
  await host.run(300);
  assert.ok(!sound.paused);
  worker.state("buffering", 0.3, { buffered: [] });
  await host.run(20);
  assert.ok(sound.paused);
  worker.state("playing", 0.3);
  await host.run(100);
  assert.ok(!sound.paused);
  player.currentTime = 5;
  await host.run(20);
  assert.ok(sound.paused);
  worker.state("playing", 5);
  await host.run(100);
  assert.ok(!sound.paused && Math.abs(sound.currentTime - player.currentTime) < 0.05);
  player.destroy();
  assert.ok(sound.paused);
});

test("a sound that is aborted while its player is loaded is not played", async (t) => {
  for (const opened of [(player) => (player.audio = "none"), (player) => player.unload(), (player) => player.destroy()]) {
    const { sound, requests } = await openWithSound(t, { opened });
    assert.deepEqual([sound, requests], [undefined, []]);
  }
});

test("a sound on another origin is not loaded unless the page sets it", async (t) => {
  const refused = await openWithSound(t, { location: "https://other.example/a.wav" });
  assert.equal(refused.requests.length, 0);
  assert.equal(refused.player.hasAudio, false);
  assert.match(refused.notices[0].message, /not on the origin of the scene/);
  refused.player.audio = "https://other.example/a.wav"; // the page's own choice
  await refused.host.run(20);
  assert.equal(refused.requests.length, 0);
  assert.deepEqual(refused.sounds.map(({ src }) => src), [undefined, "https://other.example/a.wav"]);
});

test("a sound next to a scene of another server is requested without redirects", async (t) => {
  const { requests, sound } = await openWithSound(t, { scene: "https://cdn.example/scene.stgs" });
  assert.deepEqual([requests[0].mode, requests[0].redirect, requests[0].credentials], ["cors", "error", "omit"]);
  assert.equal(sound.crossOrigin, "anonymous");
});

test("a missing sound and a disabled one leave the scene silent", async (t) => {
  const missing = await openWithSound(t, { reply: { ok: false, status: 404, url: "http://page/a.wav" } });
  assert.match(missing.notices[0].message, /a\.wav cannot be read: status 404/);
  assert.equal(missing.sound.src, undefined);
  const none = await openWithSound(t, { set: (player) => (player.audio = "none") });
  assert.deepEqual([none.requests.length, none.sound, none.notices], [0, undefined, []]);
});
