// SPDX-License-Identifier: Apache-2.0
// Files that the visitor drops on the page or chooses.
import { isShown } from "./sources";

export interface FileParts {
  /** Opens the dialogue of the browser. */
  input: HTMLInputElement;
  /** Buttons that open the dialogue. */
  buttons: HTMLElement[];
  /** Visible while a file is dragged over the page. */
  hint: HTMLElement;
  onFile(file: File): void;
}

export function listenForFiles({ input, buttons, hint, onFile }: FileParts): void {
  for (const button of buttons) button.addEventListener("click", () => input.click());
  input.addEventListener("change", () => {
    const file = input.files?.[0];
    if (file !== undefined) onFile(file);
    input.value = ""; // so that the same file can be chosen again
  });

  const hasFiles = (event: DragEvent) => event.dataTransfer?.types.includes("Files") ?? false;
  let depth = 0; // of elements that the pointer has entered
  const setDepth = (value: number) => {
    depth = Math.max(value, 0);
    hint.hidden = depth === 0;
  };
  addEventListener("dragenter", (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    setDepth(depth + 1);
  });
  addEventListener("dragleave", (event) => {
    if (hasFiles(event)) setDepth(depth - 1);
  });
  addEventListener("dragover", (event) => {
    if (hasFiles(event)) event.preventDefault();
  });
  addEventListener("drop", (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    setDepth(0);
    const files = Array.from(event.dataTransfer!.files);
    const file = files.find(({ name }) => isShown(name)) ?? files[0];
    if (file !== undefined) onFile(file);
  });
}
