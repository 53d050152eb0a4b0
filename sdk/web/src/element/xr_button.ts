// SPDX-License-Identifier: Apache-2.0
import { iconButton, setLabel } from "./dom";
import { Media } from "./media";

/** Shows the scene in a headset; hidden unless the browser and its devices can. */
export class XrButton {
  readonly root = iconButton("headset", "Enter VR", "button xr");

  constructor(private readonly media: Media) {
    this.root.hidden = true;
    this.root.addEventListener("click", () => this.toggle());
    for (const name of ["loadedmetadata", "emptied"]) {
      media.addEventListener(name, () => void this.check());
    }
    for (const name of ["enterxr", "leavexr"]) media.addEventListener(name, () => this.update());
  }

  /** A headset may be connected later, which the next source notices. */
  private async check(): Promise<void> {
    const isSupported = await this.media.supportsXR("immersive-vr");
    this.root.hidden = !(isSupported && this.media.info !== null);
  }

  private toggle(): void {
    const { media } = this;
    // Fails if the user declines; the browser has asked.
    if (media.isInXR) void media.exitXR();
    else media.enterXR("immersive-vr").catch(() => undefined);
  }

  private update(): void {
    const { isInXR } = this.media;
    this.root.setAttribute("aria-pressed", String(isInXR));
    setLabel(this.root, isInXR ? "Exit VR" : "Enter VR");
  }
}
