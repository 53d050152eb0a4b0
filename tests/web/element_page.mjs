// SPDX-License-Identifier: Apache-2.0
// Defines <stgs-player> with a core and a renderer of the test. The test creates elements.
import { defineStgsPlayer } from "../../sdk/web/src/element/stgs_player";
import { FakeCore } from "./fake_core.mjs";
import { PatternRenderer } from "./pattern_renderer.mjs";

const parts = { workers: [], renderers: [], choices: [], fails: false };

defineStgsPlayer({
  createWorker() {
    parts.workers.push(new FakeCore());
    return parts.workers[parts.workers.length - 1];
  },
  createRenderer(canvas, choice) {
    parts.choices.push(choice);
    if (parts.fails) throw new Error("WebGL 2 is not available; enable hardware acceleration");
    parts.renderers.push(new PatternRenderer(canvas));
    return parts.renderers[parts.renderers.length - 1];
  },
});

/** Puts an element with these attributes on the page and records its events. */
function show(attributes) {
  document.querySelector("stgs-player")?.remove();
  const player = document.createElement("stgs-player");
  const events = [];
  const names = [
    "loadedmetadata", "loadeddata", "canplay", "play", "playing", "pause", "seeking", "seeked",
    "ended", "error", "timeupdate", "ratechange", "emptied",
  ];
  for (const name of names) {
    player.addEventListener(name, () => events.push(name));
  }
  for (const [name, value] of Object.entries(attributes)) player.setAttribute(name, value);
  document.body.append(player);
  Object.assign(window, { player, events });
}

/** The first element of the player's shadow tree that matches. */
const part = (selector) => window.player.shadowRoot.querySelector(selector);

Object.assign(window, { parts, show, part });
// In a frame, the page states the attributes.
if (location.hash !== "") show(JSON.parse(decodeURIComponent(location.hash.slice(1))));
