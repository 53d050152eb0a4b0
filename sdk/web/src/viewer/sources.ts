// SPDX-License-Identifier: Apache-2.0
// Which scene the page shows. Nothing here touches the page, so that node can test it.

/** The settings that `stgs web` and `stgs serve` write into the element stgs-page. */
export interface PageSettings {
  /** The scene, a URL relative to the page; absent: the visitor chooses one. */
  scene?: string;
  /** Origins of pages that may embed this one and control it, as the attribute of the element; absent: none. */
  bridge?: string;
  /** A list of scenes (ListedScene), a URL relative to the page. */
  list?: string;
}

/** A scene of the list. */
export interface ListedScene {
  name: string;     // path below the folder, for display
  href: string;     // URL relative to the page
  bytes: number;
  modified: number; // seconds since the Unix epoch
}

/** The list, as stgs serve writes it. */
export interface SceneList {
  scenes: ListedScene[];
  complete: boolean; // false: there are more scenes than the list holds
}

/** Reads the settings of the page. Invalid ones throw: the program that writes them is at fault. */
export function parseSettings(text: string): PageSettings {
  return JSON.parse(text) as PageSettings;
}

/**
 * Returns the absolute URL of the parameter `src`, or null if it is not permitted. A link may show
 * scenes of the page's own server, or of others by https; a link to a page must not make it read
 * files, or anything else that the page can reach.
 */
export function linkedScene(src: string, page: string): URL | null {
  let url: URL;
  const base = new URL(page);
  try {
    url = new URL(src, base);
  } catch {
    return null;
  }
  if (url.protocol === "https:") return url;
  return url.protocol === "http:" && url.origin === base.origin ? url : null;
}

/** The endings of files that the page shows: scenes, and models, which it converts. */
const ENDINGS = /\.(stgs|ply|spz|sog)$/i;

/** Whether the page shows files of this name. */
export function isShown(name: string): boolean {
  return ENDINGS.test(name);
}

/** Whether a file of this name is a model. */
export function isModel(name: string): boolean {
  return isShown(name) && !/\.stgs$/i.test(name);
}

/** Returns the name of a file for display. */
export function withoutEnding(name: string): string {
  return name.replace(ENDINGS, "");
}

/** Returns the name of a scene for the title: the last part of its path. */
export function nameOf(url: URL): string {
  const last = url.pathname.split("/").pop() ?? "";
  try {
    return withoutEnding(decodeURIComponent(last));
  } catch {
    return withoutEnding(last); // not UTF-8
  }
}

/** Checks a list that was fetched. Throws if it is invalid. */
export function checkedList(value: unknown): SceneList {
  const list = value as SceneList;
  const isScene = (scene: ListedScene) => typeof scene.name === "string" && typeof scene.href === "string" &&
    Number.isFinite(scene.bytes) && Number.isFinite(scene.modified);
  if (!Array.isArray(list?.scenes) || !list.scenes.every(isScene)) throw new Error("the list of scenes is invalid");
  return list;
}
