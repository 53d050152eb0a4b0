// SPDX-License-Identifier: Apache-2.0
// The parts of a page of one file: elements with the content of files as base64, the core compressed
// (stgs web --single-file).
import type { Resources } from "../resources";

/** Returns the text of an element, and removes it: the text takes memory. */
function take(element: Element | null): string {
  if (element === null) throw new Error("a part of the page is missing");
  element.remove();
  return element.textContent ?? "";
}

function bytesOf(base64: string): Uint8Array {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
  return bytes;
}

/** Returns the files of the package in the page; null if it has none. */
export async function inlinedResources(): Promise<Resources | null> {
  const core = document.getElementById("stgs-core");
  if (core === null) return null;
  // A worker from a data: URL has no origin and could not fetch scenes from the page's server (?src=). A
  // page opened from disk cannot start modules from Blobs, and has no server.
  const isHosted = /^https?:$/.test(location.protocol);
  const script = (id: string) => {
    const base64 = take(document.getElementById(id));
    if (!isHosted) return `data:text/javascript;base64,${base64}`;
    return URL.createObjectURL(new Blob([bytesOf(base64)], { type: "text/javascript" }));
  };
  const stream = new Blob([bytesOf(take(core))]).stream().pipeThrough(new DecompressionStream("gzip"));
  return { worker: script("stgs-worker"), sorter: script("stgs-sorter"), core: await new Response(stream).arrayBuffer() };
}

/** Returns a file in the page, the content of the elements of a class in order; null if there is none. */
function inlinedFile(name: string): Blob | null {
  const elements = document.querySelectorAll<HTMLElement>(`.${name}`);
  if (elements.length === 0) return null;
  return new Blob(Array.from(elements, (element) => bytesOf(take(element))), { type: elements[0].dataset["type"] ?? "" });
}

/** Returns the scene in the page; null if there is none. */
export const inlinedScene = (): Blob | null => inlinedFile("stgs-scene");

/** Returns a URL of the audio file in the page, valid as long as the page; null if there is none. */
export function inlinedAudio(): string | null {
  const audio = inlinedFile("stgs-audio");
  return audio === null ? null : URL.createObjectURL(audio);
}
