// SPDX-License-Identifier: Apache-2.0
// The sound of scenes: a separate bundle, which is loaded only for scenes with sound.
import { AudioTrack } from "./audio/audio_track";
import type { Timebase, TrackOwner } from "./audio/audio_track";
import { checkedUrl, soundUrl } from "./audio/location";
import type { Host } from "./player/host";
import type { SceneAudio } from "./types";

export type { AudioTrack, Timebase, TrackOwner };

/** A sound: the location in a file, or the URL that the page has chosen. */
export interface SoundSource {
  scene: SceneAudio | null;
  chosen: string | null;
}

/**
 * Resolves to the track of a sound, which then loads. Rejects with an Error if the location in a file is
 * not permitted or cannot be read. The page may choose any location.
 */
export async function openSound(
  { scene, chosen }: SoundSource, timebase: Timebase, host: Host, owner: TrackOwner, signal: AbortSignal,
): Promise<AudioTrack> {
  const element = new Audio();
  element.preload = "auto";
  const track = new AudioTrack(element, scene?.begin ?? 0, timebase, host, owner);
  signal.addEventListener("abort", () => {
    track.destroy();
    element.removeAttribute("src"); // stops the download
    element.load();
  });
  if (chosen !== null) {
    element.src = chosen;
    return track;
  }
  const url = soundUrl(scene!);
  const checked = await checkedUrl(url, signal);
  if (url.origin !== location.origin) element.crossOrigin = "anonymous";
  if (!signal.aborted) element.src = checked;
  return track;
}
