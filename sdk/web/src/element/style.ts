// SPDX-License-Identifier: Apache-2.0

/** The style sheet of the element's shadow tree. */
export const STYLE = `
:host {
  --accent: #6ea8ff;
  --text: rgba(255, 255, 255, 0.94);
  --quiet: rgba(255, 255, 255, 0.7);
  --panel: rgba(18, 20, 24, 0.88);
  --line: rgba(255, 255, 255, 0.1);
  display: block;
  position: relative;
  aspect-ratio: 16 / 9;
  min-width: 0;
  overflow: hidden;
  contain: content;
  background: #08090b;
  color: var(--text);
  font: 13px/1.4 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif;
  -webkit-font-smoothing: antialiased;
  -webkit-tap-highlight-color: transparent;
  user-select: none;
  -webkit-user-select: none;
}
:host([hidden]) { display: none; }
:host(:fullscreen) { width: 100vw; height: 100vh; aspect-ratio: auto; }
[hidden] { display: none !important; }
* { box-sizing: border-box; }
.root, .view, canvas, .poster { position: absolute; inset: 0; width: 100%; height: 100%; }
canvas { display: block; }
.root:not(.has-frame) canvas { visibility: hidden; }
.view { cursor: grab; touch-action: none; outline: none; }
.view.grabbing { cursor: grabbing; }
.view:focus-visible::after {
  content: ""; position: absolute; inset: 0; pointer-events: none;
  box-shadow: inset 0 0 0 2px var(--accent);
}
.poster {
  object-fit: contain; background: #08090b; pointer-events: none;
  transition: opacity 0.3s, visibility 0.3s;
}
.has-frame .poster { opacity: 0; visibility: hidden; }
.hidden-text {
  position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%);
}

button {
  font: inherit; color: inherit; background: none; border: 0; margin: 0; padding: 0;
  cursor: pointer;
}
button:focus-visible, .item:focus-visible {
  outline: 2px solid var(--accent); outline-offset: -2px;
}
svg { display: block; width: 1em; height: 1em; }
.filled { fill: currentColor; }
.lines {
  fill: none; stroke: currentColor; stroke-width: 1.8; stroke-linecap: round;
  stroke-linejoin: round;
}

.bar {
  position: absolute; left: 0; right: 0; bottom: 0; padding: 56px 14px 8px;
  background: linear-gradient(to top, rgba(6, 7, 9, 0.86), rgba(6, 7, 9, 0.5) 55%, transparent);
  pointer-events: none; transition: opacity 0.2s, visibility 0.2s;
}
.bar > * { pointer-events: auto; }
.failed .bar { visibility: hidden; }
.idle .bar { opacity: 0; visibility: hidden; }
.idle .view { cursor: none; }
.row { display: flex; align-items: center; margin-top: 2px; }
.space { flex: 1; }

.button {
  flex: none; display: grid; place-items: center; min-width: 40px; height: 40px; border-radius: 8px;
  font-size: 22px; color: var(--text); transition: background-color 0.12s, color 0.12s;
}
.button.play { font-size: 25px; margin-left: -8px; }
.button.speed {
  font-size: 13px; font-weight: 600; padding: 0 8px; font-variant-numeric: tabular-nums;
}
.button.live {
  grid-auto-flow: column; gap: 5px; padding: 0 8px; font-size: 12px; font-weight: 600;
}
.button.live::before { content: "●"; opacity: 0.5; }
.button.live[aria-pressed="true"]::before { color: #ff5c5c; opacity: 1; }
.button.loop, .button.statistics, .button.xr { color: rgba(255, 255, 255, 0.8); }
.button[aria-pressed="true"]:not(.live) { color: var(--accent); }
.button.fullscreen { margin-right: -8px; }
.time {
  padding: 0 10px 0 6px; white-space: nowrap; font-variant-numeric: tabular-nums;
  color: var(--text);
}
.total { color: var(--quiet); }
.total::before { content: "/"; padding: 0 0.4em; }

.seek {
  position: relative; height: 20px; cursor: pointer; touch-action: none; border-radius: 6px;
  outline: none;
}
.track {
  position: absolute; left: 0; right: 0; top: calc(50% - 2px); height: 4px; border-radius: 2px;
  overflow: hidden;
  background: rgba(255, 255, 255, 0.2); transition: transform 0.12s;
}
.seek:focus-visible .track { outline: 2px solid var(--accent); outline-offset: 5px; }
.seek.hover .track, .seek.scrubbing .track { transform: scaleY(1.5); }
.buffered > div {
  position: absolute; top: 0; bottom: 0; background: rgba(255, 255, 255, 0.32);
}
.played {
  position: absolute; inset: 0; background: var(--accent); transform: scaleX(0);
  transform-origin: 0 0;
}
.thumb {
  position: absolute; top: calc(50% - 6px); width: 12px; height: 12px; margin-left: -6px;
  border-radius: 50%;
  background: #fff; box-shadow: 0 0 4px rgba(0, 0, 0, 0.5); transform: scale(0);
  transition: transform 0.12s; pointer-events: none;
}
.seek.hover .thumb, .seek:focus-visible .thumb { transform: scale(1); }
.seek.scrubbing .thumb { transform: scale(1.2); }
.hint {
  position: absolute; bottom: 24px; padding: 3px 7px; border-radius: 6px;
  transform: translateX(-50%);
  background: var(--panel); font-size: 12px; font-variant-numeric: tabular-nums; visibility: hidden;
  pointer-events: none;
}
.seek.hover .hint, .seek.scrubbing .hint { visibility: visible; }

.speed-menu { position: relative; }
.menu {
  position: absolute; right: 0; bottom: 46px; min-width: 124px; overflow-y: auto;
  max-height: calc(var(--height) - 64px); padding: 5px; border-radius: 10px;
  background: var(--panel); border: 1px solid var(--line);
  box-shadow: 0 8px 28px rgba(0, 0, 0, 0.45);
  backdrop-filter: blur(14px);
}
.item {
  display: flex; align-items: center; min-height: 32px; padding: 0 12px 0 28px; border-radius: 6px;
  cursor: pointer; position: relative; font-variant-numeric: tabular-nums; outline: none;
}
.item[aria-checked="true"]::before {
  content: ""; position: absolute; left: 12px; width: 6px; height: 6px; border-radius: 50%;
  background: var(--accent);
}

.start {
  position: absolute; left: 50%; top: 50%; width: 76px; height: 76px; margin: -38px;
  font-size: 38px;
  border-radius: 50%; display: grid; place-items: center; background: rgba(14, 16, 20, 0.62);
  border: 1px solid rgba(255, 255, 255, 0.16); backdrop-filter: blur(10px);
  transition: background-color 0.15s, transform 0.15s;
}
.start svg { transform: translateX(0.03em); }
.spinner {
  position: absolute; left: 50%; top: 50%; width: 44px; height: 44px; margin: -22px;
  border-radius: 50%; border: 3px solid rgba(255, 255, 255, 0.18); border-top-color: var(--text);
  pointer-events: none;
  animation: turn 0.9s linear infinite, appear 0.2s 0.3s both;
}
@keyframes turn { to { transform: rotate(1turn); } }
@keyframes appear { from { opacity: 0; } }

.figures {
  max-height: calc(var(--height) - 28px); overflow: hidden;
  box-sizing: border-box; max-width: min(340px, calc(100% - 28px));
  position: absolute; left: 14px; top: 14px; margin: 0; padding: 10px 14px; border-radius: 10px;
  display: grid; grid-template-columns: auto auto; gap: 2px 18px; font-size: 12px; line-height: 1.5;
  background: rgba(12, 14, 17, 0.72); border: 1px solid var(--line); backdrop-filter: blur(10px);
  pointer-events: none; font-variant-numeric: tabular-nums;
}
dt { color: var(--quiet); }
dd { margin: 0; text-align: right; }

.error {
  position: absolute; inset: 0; padding: 24px; display: flex; flex-direction: column; gap: 8px;
  align-items: center; justify-content: center; text-align: center;
  background: rgba(10, 11, 14, 0.92);
}
.error svg { font-size: 40px; color: #ff8a80; }
.error h2 { margin: 4px 0 0; font-size: 16px; font-weight: 600; }
.error p {
  margin: 0; max-width: 56ch; max-height: 40%; overflow: auto; color: var(--quiet);
  overflow-wrap: anywhere; user-select: text; -webkit-user-select: text;
}
.retry {
  margin-top: 10px; padding: 8px 18px; border-radius: 8px; font-weight: 600;
  background: rgba(255, 255, 255, 0.12); transition: background-color 0.12s;
}

@media (hover: hover) {
  .button:hover, .retry:hover { background: rgba(255, 255, 255, 0.14); color: #fff; }
  .button[aria-pressed="true"]:not(.live):hover { color: var(--accent); }
  .item:hover { background: rgba(255, 255, 255, 0.1); }
  .start:hover { background: rgba(24, 28, 34, 0.8); transform: scale(1.05); }
}
@media (hover: none) {
  .thumb { transform: scale(1); }
}
@media (pointer: coarse) {
  .seek { height: 28px; }
  .button { height: 44px; }
}
.item:focus { background: rgba(255, 255, 255, 0.1); }

.narrow .bar { padding-left: 10px; padding-right: 10px; padding-bottom: 4px; }
.narrow .time { font-size: 12px; padding: 0 2px; }
.narrow .button { min-width: 36px; }
.narrow .button.speed, .narrow .button.live { padding: 0 4px; }
.narrow .start { width: 64px; height: 64px; margin: -32px; font-size: 32px; }
.narrow .figures { left: 8px; top: 8px; padding: 8px 10px; font-size: 11px; }

.short .bar { padding-top: 32px; }
.short .start {
  width: 52px; height: 52px; margin: -26px; font-size: 28px; top: calc(50% - 22px);
}
.short .figures {
  grid-template-columns: repeat(4, auto); gap: 0 12px; padding: 6px 10px; max-width: calc(100% - 28px);
}
.short .error { padding: 12px; gap: 4px; }
.short .error svg { display: none; }
.short .retry { margin-top: 6px; padding: 6px 16px; }

@media (prefers-reduced-motion: reduce) {
  * { transition: none !important; }
  .spinner { animation-duration: 2.4s, 0s; }
}
@media (forced-colors: active) {
  .played { background: Highlight; }
  .track { border: 1px solid CanvasText; }
}
`;
