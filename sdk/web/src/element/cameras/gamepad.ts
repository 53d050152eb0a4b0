// SPDX-License-Identifier: Apache-2.0
import { Drive } from "./rig";

const DEAD_ZONE = 0.15; // of a stick's deflection
const TRIGGER_BOOST = 3; // factor of the speed that the right trigger adds
const BUTTONS: Readonly<Record<number, PadAction>> = {
  0: "toggle",
  3: "reset",
  14: "back",
  15: "ahead",
};

/**
 * Actions of buttons: A plays and pauses, Y resets the camera, left and right of the cross seek.
 */
export type PadAction = "toggle" | "reset" | "back" | "ahead";

/** The part of a `Gamepad` of the standard mapping that is read. */
export interface PadState {
  axes: readonly number[];
  buttons: readonly { pressed: boolean; value: number }[];
}

/**
 * Reads a gamepad of the standard mapping: the left stick moves, the right one turns, the shoulder
 * buttons move down and up, the right trigger is faster.
 */
export class PadReader {
  private pressed = new Set<number>();

  /** Returns the motion, and the actions of buttons pressed since the last call. */
  read({ axes, buttons }: PadState): { drive: Drive; actions: PadAction[] } {
    const actions: PadAction[] = [];
    const pressed = new Set<number>();
    buttons.forEach((button, index) => {
      if (!button.pressed) return;
      pressed.add(index);
      if (index in BUTTONS && !this.pressed.has(index)) actions.push(BUTTONS[index]);
    });
    this.pressed = pressed;
    const [right, back] = stick(axes[0] ?? 0, axes[1] ?? 0);
    const [turnRight, turnDown] = stick(axes[2] ?? 0, axes[3] ?? 0);
    const up = Number(pressed.has(5)) - Number(pressed.has(4));
    const boost = 1 + TRIGGER_BOOST * (buttons[7]?.value ?? 0);
    const drive = { right, up, forward: 0 - back, turnRight, turnUp: 0 - turnDown, boost };
    return { drive, actions };
  }
}

/** Removes the dead zone and keeps the direction; small deflections are finer. */
function stick(x: number, y: number): [number, number] {
  const deflection = Math.hypot(x, y);
  if (deflection <= DEAD_ZONE) return [0, 0];
  const strength = Math.min((deflection - DEAD_ZONE) / (1 - DEAD_ZONE), 1);
  const factor = (strength * strength) / deflection;
  // Adding 0 turns -0 into 0.
  return [x * factor + 0, y * factor + 0];
}
