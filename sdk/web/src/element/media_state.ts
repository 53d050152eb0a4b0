// SPDX-License-Identifier: Apache-2.0
// The properties of <stgs-player> that only report the state of its player.
import { PlayerError } from "../player/errors";
import { NO_STATS, PlayerStats, StgsPlayer } from "../player/player";
import { BufferedRanges } from "../player/ranges";
import { LiveState, SceneInfo } from "../types";
import { ReflectedElement } from "./reflected_element";

/** An element with these properties, which have the values of an unused player while there is none. */
export abstract class MediaState extends ReflectedElement {
  protected player: StgsPlayer | null = null;
  protected failure: PlayerError | null = null; // of a player that could not be created

  /** See `StgsPlayer.activeRenderer`. */
  get activeRenderer(): "webgl2" | "webgpu" | null {
    return this.player?.activeRenderer ?? null;
  }
  get hasAudio(): boolean {
    return this.player?.hasAudio ?? false;
  }
  get duration(): number {
    return this.player?.duration ?? NaN;
  }
  get buffered(): BufferedRanges {
    return this.player?.buffered ?? new BufferedRanges([]);
  }
  get paused(): boolean {
    return this.player?.paused ?? true;
  }
  get ended(): boolean {
    return this.player?.ended ?? false;
  }
  get seeking(): boolean {
    return this.player?.seeking ?? false;
  }
  get hasSource(): boolean {
    return this.player?.hasSource ?? false;
  }
  get readyState(): number {
    return this.player?.readyState ?? StgsPlayer.HAVE_NOTHING;
  }
  get error(): PlayerError | null {
    return this.player?.error ?? this.failure;
  }
  get info(): SceneInfo | null {
    return this.player?.info ?? null;
  }
  get live(): LiveState | null {
    return this.player?.live ?? null;
  }
  get stats(): PlayerStats {
    return this.player?.stats ?? NO_STATS;
  }
  /** Whether the scene is shown in a headset. */
  get isInXR(): boolean {
    return this.player?.isInXR ?? false;
  }
}
