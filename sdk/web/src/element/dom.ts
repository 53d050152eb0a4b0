// SPDX-License-Identifier: Apache-2.0
import { icon, IconName } from "./icons";

type Attributes = Readonly<Record<string, string>>;

/** Creates an HTML element with attributes and children. */
export function create<K extends keyof HTMLElementTagNameMap>(
  tag: K, attributes: Attributes = {}, ...children: (Node | string)[]
): HTMLElementTagNameMap[K] {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

/** Creates a button with an icon; `label` is its name and its tooltip. */
export function iconButton(name: IconName, label: string, className: string): HTMLButtonElement {
  const button = create("button", { type: "button", class: className }, icon(name));
  setLabel(button, label);
  return button;
}

export function setLabel(button: HTMLElement, label: string): void {
  if (button.getAttribute("aria-label") === label) return;
  button.setAttribute("aria-label", label);
  button.title = label;
}

export function setIcon(button: HTMLElement, name: IconName): void {
  if (button.dataset["icon"] === name) return;
  button.dataset["icon"] = name;
  button.replaceChildren(icon(name));
}

/** Observes the size of an element and, where supported, its pixel ratio, which changes when the page is zoomed. */
export function observePixels(observer: ResizeObserver, element: Element): void {
  try {
    observer.observe(element, { box: "device-pixel-content-box" });
  } catch {
    observer.observe(element); // the browser does not support this box
  }
}
