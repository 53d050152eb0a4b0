// SPDX-License-Identifier: Apache-2.0
import { Drive } from "./rig";

const FAST = 4; // factor of the speed with the shift key

const AXES: Readonly<Record<string, readonly [keyof Drive, number]>> = {
  KeyW: ["forward", 1],
  KeyS: ["forward", -1],
  KeyD: ["right", 1],
  KeyA: ["right", -1],
  KeyE: ["up", 1],
  KeyQ: ["up", -1],
};

/** The keys that fly: W A S D along the ground, E and Q up and down, shift faster. */
export class FlyKeys {
  private readonly held = new Set<string>();
  private fast = false;

  /** Takes a `KeyboardEvent.code`. Returns whether it is a key that flies. */
  down(code: string, shift: boolean): boolean {
    this.fast = shift;
    if (!(code in AXES)) return false;
    this.held.add(code);
    return true;
  }

  /** Returns whether the motion changed. */
  up(code: string, shift: boolean): boolean {
    const changed = this.held.has(code) || this.fast !== shift;
    this.fast = shift;
    this.held.delete(code);
    return changed;
  }

  /** Releases all keys: the page no longer receives their events. */
  clear(): void {
    this.held.clear();
    this.fast = false;
  }

  drive(): Drive {
    const boost = this.fast ? FAST : 1;
    const drive: Drive = { right: 0, up: 0, forward: 0, turnRight: 0, turnUp: 0, boost };
    for (const code of this.held) {
      const [axis, sign] = AXES[code];
      drive[axis] += sign;
    }
    return drive;
  }
}
