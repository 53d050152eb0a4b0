// SPDX-License-Identifier: Apache-2.0
// A page that embeds a page with a player.
import { connect } from "../../sdk/web/src/stgs-bridge";

/** Embeds a page. */
function embed(src) {
  document.querySelector("iframe")?.remove();
  const frame = document.createElement("iframe");
  frame.src = src;
  frame.style.cssText = "width: 640px; height: 360px; border: 0";
  document.body.append(frame);
  return frame;
}

/** Connects to the player of a page, and records its events. */
async function open(src, options) {
  const remote = await connect(embed(src), options);
  const names = [];
  for (const name of ["connect", "playing", "pause", "seeked", "volumechange", "timeupdate"])
    remote.addEventListener(name, () => names.push(name));
  Object.assign(window, { remote, names });
}

/** Resolves to the text of the error with which a promise rejects. */
const failure = (promise) => promise.then(() => "none", ({ name, message }) => `${name}: ${message}`);

/** Connects as connect() does; resolves to the port once its first event has come. */
function rawPort(frame) {
  const { port1, port2 } = new MessageChannel();
  frame.contentWindow.postMessage({ stgs: "connect", version: 1 }, new URL(frame.src).origin, [port2]);
  return new Promise((resolve) => (port1.onmessage = () => resolve(port1)));
}

/** Sends messages to a port; resolves to the answers to those with an id, once the last one has come. */
function exchange(port, messages, last) {
  const replies = [];
  return new Promise((resolve) => {
    port.onmessage = ({ data }) => {
      if (data.type !== "reply") return;
      replies.push(data);
      if (data.id === last) resolve(replies);
    };
    for (const message of messages) port.postMessage(message);
  });
}

Object.assign(window, { connect, embed, open, failure, rawPort, exchange });
