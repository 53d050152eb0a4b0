// SPDX-License-Identifier: Apache-2.0
// Which sound a scene may name (spec 4.6, 12.3): following a location reveals the address of the viewer,
// so a file can only lead to the server that it is from.
import type { SceneAudio } from "../types";

const MAX_SHOWN = 200; // characters of a location in messages

/** Returns the location for a message. */
function shown(location: string): string {
  return location.length > MAX_SHOWN ? `${location.slice(0, MAX_SHOWN)}…` : location;
}

/** Returns the URL of the sound that a file names. Throws an Error if it is not followed. */
export function soundUrl({ location, base }: SceneAudio): URL {
  const refused = (why: string) => new Error(`the sound "${shown(location)}" is not played: ${why}`);
  if (!/^https?:/.test(base)) throw refused("the scene is not from a server");
  let url: URL;
  try {
    url = new URL(location, base);
  } catch {
    throw refused("it is no valid reference");
  }
  // The origin of a blob: URL is that of the page that made it.
  const isSame = url.origin === new URL(base).origin && url.protocol !== "blob:";
  if (!isSame || url.username !== "" || url.password !== "")
    throw refused("it is of another origin than the scene; the page can name it (audio)");
  return url;
}

/**
 * Resolves to the URL of a sound after redirects, none of which has left its origin. Rejects with an
 * Error if the server does not have it. No other origin is contacted. Whether the server redirects the
 * later requests of an audio element cannot be checked.
 */
export async function checkedUrl(url: URL, signal: AbortSignal): Promise<string> {
  const isOwn = url.origin === location.origin;
  // Of another origin than the page, only a request without redirects is known to stay there.
  const where: RequestInit = isOwn ? { mode: "same-origin" } : { mode: "cors", redirect: "error", credentials: "omit" };
  let response: Response;
  try {
    // Not HEAD, which a server may answer without the redirect of GET.
    response = await fetch(url.href, { headers: { Range: "bytes=0-0" }, signal, ...where });
  } catch (error) {
    if (signal.aborted) throw error;
    throw new Error(`the sound ${shown(url.href)} cannot be read: no connection, a redirect to another origin, ` +
      "or the server does not allow this page (CORS)");
  }
  response.body?.cancel().catch(() => undefined); // it is not needed
  if (!response.ok) throw new Error(`the sound ${shown(url.href)} cannot be read: status ${response.status} of the server`);
  return response.url;
}
