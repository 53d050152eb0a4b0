// SPDX-License-Identifier: Apache-2.0
// The audio files that a scene may name (spec 4.6, 12.3): a request reveals the address of the viewer, so
// a scene may only name audio files on its own server.
import type { SceneAudio } from "../types";

const MAX_SHOWN = 200; // characters of a location in messages

/** Returns the location for a message. */
function shown(location: string): string {
  return location.length > MAX_SHOWN ? `${location.slice(0, MAX_SHOWN)}…` : location;
}

/** Returns the URL of the sound that a file names. Throws an Error if the location is not permitted. */
export function soundUrl({ location, base }: SceneAudio): URL {
  const refused = (why: string) => new Error(`the sound "${shown(location)}" is not played: ${why}`);
  if (!/^https?:/.test(base)) throw refused("the scene is not from a server");
  let url: URL;
  try {
    url = new URL(location, base);
  } catch {
    throw refused("it is not a valid URL reference");
  }
  // The origin of a blob: URL is that of the page that made it.
  const isSame = url.origin === new URL(base).origin && url.protocol !== "blob:";
  if (!isSame || url.username !== "" || url.password !== "")
    throw refused("it is not on the origin of the scene; set the attribute audio to play it anyway");
  return url;
}

/**
 * Resolves to the URL of a sound after redirects, which must stay on its origin: no other origin is
 * contacted. Rejects with an Error if the sound cannot be read. Redirects of the later requests of an audio
 * element cannot be checked.
 */
export async function checkedUrl(url: URL, signal: AbortSignal): Promise<string> {
  const isOwn = url.origin === location.origin;
  // A request to another origin than the page's can only be kept there by refusing redirects.
  const where: RequestInit = isOwn ? { mode: "same-origin" } : { mode: "cors", redirect: "error", credentials: "omit" };
  let response: Response;
  try {
    // Not HEAD: a server may redirect only GET.
    response = await fetch(url.href, { headers: { Range: "bytes=0-0" }, signal, ...where });
  } catch (error) {
    if (signal.aborted) throw error;
    throw new Error(`the sound ${shown(url.href)} cannot be read: no connection, a redirect to another origin, ` +
      "or the server does not allow this page (CORS)");
  }
  response.body?.cancel().catch(() => undefined); // it is not needed
  if (!response.ok) throw new Error(`the sound ${shown(url.href)} cannot be read: status ${response.status} from the server`);
  return response.url;
}
