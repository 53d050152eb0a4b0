// SPDX-License-Identifier: Apache-2.0

const imports = new Map<string, string>(); // by URL of another origin: the URL of a Blob that imports it

/**
 * Returns the URL with which a page starts a script as a module worker. Browsers refuse scripts of other origins, such as
 * a CDN: for them, it is the URL of a Blob that imports the script, which the server must allow (CORS). The Blob is never
 * revoked, because the worker starts further workers from this URL at any time. The origin of a sandboxed frame is "null",
 * so that all scripts are of other origins.
 */
export function workerUrl(script: URL): string {
  const { href, origin, protocol } = script;
  if (!/^https?:$/.test(protocol) || origin === self.origin) return href;
  let url = imports.get(href);
  if (url === undefined) {
    url = URL.createObjectURL(new Blob([`import ${JSON.stringify(href)};`], { type: "text/javascript" }));
    imports.set(href, url);
  }
  return url;
}
