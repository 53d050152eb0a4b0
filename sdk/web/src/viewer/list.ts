// SPDX-License-Identifier: Apache-2.0
// The list of scenes of stgs serve FOLDER.
import { create } from "../element/dom";
import { formatBytes } from "../element/text";
import { ListedScene, SceneList, withoutEnding } from "./sources";

/** Fills the list. `note` receives a remark to display. */
export function showList({ scenes, complete }: SceneList, list: HTMLElement, note: HTMLElement): void {
  list.replaceChildren(...scenes.map((scene) => create("li", {}, entry(scene))));
  if (!complete) note.textContent = `Only ${scenes.length} scenes are listed; serve a smaller folder to see the others.`;
  else if (scenes.length === 0) note.textContent = "There are no .stgs files in this folder yet. Drop one here to play it.";
  note.hidden = scenes.length > 0 && complete;
}

function entry({ name, href, bytes, modified }: ListedScene): HTMLElement {
  const cut = name.lastIndexOf("/") + 1;
  const label = create("span", { class: "label" });
  if (cut > 0) label.append(create("span", { class: "folder" }, name.slice(0, cut)));
  label.append(withoutEnding(name.slice(cut)));
  const date = new Date(modified * 1000).toLocaleDateString(undefined, { dateStyle: "medium" });
  return create("a", { class: "scene", href: `?src=${encodeURIComponent(href)}` }, label,
                create("span", { class: "fact" }, formatBytes(bytes)), create("span", { class: "fact" }, date));
}
