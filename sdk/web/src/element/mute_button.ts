// SPDX-License-Identifier: Apache-2.0
import { iconButton, setIcon, setLabel } from "./dom";
import { Media } from "./media";

/** Turns the sound off and on; hidden unless the scene has one. */
export class MuteButton {
  readonly root = iconButton("volume", "Mute", "button mute");

  constructor(private readonly media: Media) {
    this.root.addEventListener("click", () => (media.muted = !media.muted));
    for (const name of ["audiochange", "volumechange"]) media.addEventListener(name, () => this.update());
    this.update();
  }

  /** Shows the state of the media. */
  update(): void {
    const { muted, hasAudio } = this.media;
    this.root.hidden = !hasAudio;
    setIcon(this.root, muted ? "muted" : "volume");
    setLabel(this.root, muted ? "Unmute" : "Mute");
  }
}
