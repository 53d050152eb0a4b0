// SPDX-License-Identifier: Apache-2.0
// Icons on a grid of 24 x 24: filled shapes, and lines.

const FILLED = {
  play: "M7.5 5.6c0-.9 1-1.5 1.8-1l10.2 6.4c.7.5.7 1.5 0 2L9.3 19.4c-.8.5-1.8-.1-1.8-1z",
  pause: "M7 5h2.4c.4 0 .8.4.8.8v12.4c0 .4-.4.8-.8.8H7c-.4 0-.8-.4-.8-.8V5.8c0-.4.4-.8.8-.8z" +
    "m7.6 0H17c.4 0 .8.4.8.8v12.4c0 .4-.4.8-.8.8h-2.4c-.4 0-.8-.4-.8-.8V5.8c0-.4.4-.8.8-.8z",
};

const LINES = {
  replay: "M5 12a7 7 0 1 0 2.2-5.1M4.8 4.2v4.2H9",
  loop: "M4.5 11.5a5 5 0 0 1 5-5h8.7M15.4 3.4l3.1 3.1-3.1 3.1M19.5 12.5a5 5 0 0 1-5 5H5.8" +
    "M8.6 20.6l-3.1-3.1 3.1-3.1",
  stats: "M5.2 18.5v-5M9.7 18.5v-12M14.3 18.5v-8.5M18.8 18.5v-3.5",
  enterFullscreen: "M4.8 9V6c0-.7.5-1.2 1.2-1.2h3M15 4.8h3c.7 0 1.2.5 1.2 1.2v3" +
    "M19.2 15v3c0 .7-.5 1.2-1.2 1.2h-3M9 19.2H6c-.7 0-1.2-.5-1.2-1.2v-3",
  exitFullscreen: "M9 4.8v3C9 8.5 8.5 9 7.8 9h-3M19.2 9h-3C15.5 9 15 8.5 15 7.8v-3" +
    "M15 19.2v-3c0-.7.5-1.2 1.2-1.2h3M4.8 15h3c.7 0 1.2.5 1.2 1.2v3",
  headset: "M5 7.5h14c1.1 0 2 .9 2 2v5.5c0 1.1-.9 2-2 2h-3.2c-.6 0-1.1-.3-1.5-.8L12.9 14.6c-.5-.6-1.4-.6-1.9 0" +
    "L9.7 16.2c-.4.5-.9.8-1.5.8H5c-1.1 0-2-.9-2-2V9.5c0-1.1.9-2 2-2z",
  volume: "M4.5 9.5v5h3.2l4.3 3.6V5.9L7.7 9.5zM15.2 9.2a4 4 0 0 1 0 5.6M17.9 6.8a7.4 7.4 0 0 1 0 10.4",
  muted: "M4.5 9.5v5h3.2l4.3 3.6V5.9L7.7 9.5zM15.6 9.6l4.8 4.8M20.4 9.6l-4.8 4.8",
  alert: "M12 3.6a8.4 8.4 0 1 0 0 16.8 8.4 8.4 0 0 0 0-16.8zM12 8v4.8M12 16v.1",
};

export type IconName = keyof typeof FILLED | keyof typeof LINES;

/** Returns a decorative `svg` element. Colour and size are those of the text around it. */
export function icon(name: IconName): SVGElement {
  const namespace = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(namespace, "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(namespace, "path");
  const isFilled = name in FILLED;
  path.setAttribute("d", { ...FILLED, ...LINES }[name]);
  path.setAttribute("class", isFilled ? "filled" : "lines");
  svg.append(path);
  return svg;
}
