// SPDX-License-Identifier: Apache-2.0
// Binds pointers, the wheel, keys and gamepads to a camera.
import { CameraSource } from "../player/frame_loop";
import { Camera } from "../types";
import { DragGestures } from "./cameras/drag";
import { PadAction, PadReader } from "./cameras/gamepad";
import { FlyKeys } from "./cameras/keys";
import { CameraRig, Drive, NO_DRIVE } from "./cameras/rig";
import { cameraKey } from "./keyboard";

const WHEEL_ZOOM = 0.0015; // logarithm of the distance per CSS pixel
const LINE_HEIGHT = 16; // CSS pixels of a wheel that counts lines

export interface CameraInputOptions {
  /** Receives pointers and the wheel. */
  view: HTMLElement;
  /** Receives keys from its focused descendants. */
  host: HTMLElement;
  rig: CameraRig;
  /** Whether keys fly. */
  flies: boolean;
  /** The camera may have moved. */
  onMove(): void;
  /** A pointer was pressed and released without a drag. */
  onTap(event: PointerEvent): void;
  onPadAction(action: PadAction): void;
}

/** The camera of a scene with its input, until `destroy`. */
export class CameraInput implements CameraSource {
  private readonly gestures: DragGestures;
  private readonly keys = new FlyKeys();
  private readonly pads = new Map<number, PadReader>();
  private readonly abort = new AbortController();
  private isHovered = false; // by a pointer that moved, not by a page that scrolled below it

  constructor(private readonly options: CameraInputOptions) {
    const { view, rig } = options;
    this.gestures = new DragGestures(rig, () => Math.max(view.clientWidth, view.clientHeight, 1));
    this.bindPointers();
    this.bindKeys();
    for (const type of ["gamepadconnected", "gamepaddisconnected", "focus"]) {
      window.addEventListener(type, () => this.drive(), { signal: this.abort.signal });
    }
  }

  update(now: number): boolean {
    const polls = this.readPads();
    return this.options.rig.update(now) || polls;
  }

  camera(width: number, height: number): Camera {
    return this.options.rig.camera(width, height);
  }

  destroy(): void {
    this.abort.abort();
    this.gestures.cancel();
  }

  private bindPointers(): void {
    const { view } = this.options;
    this.listen(view, "pointerdown", (event) => this.onDown(event));
    this.listen(view, "pointermove", (event) => this.onPointerMove(event));
    this.listen(view, "pointerup", (event) => this.onUp(event));
    this.listen(view, "pointercancel", () => {
      this.gestures.cancel();
      view.classList.remove("grabbing");
    });
    this.listen(view, "pointerenter", () => this.options.onMove());
    this.listen(view, "pointerleave", () => (this.isHovered = false));
    this.listen(view, "contextmenu", (event) => event.preventDefault());
    this.listen(view, "wheel", (event) => this.onWheel(event), { passive: false });
  }

  private bindKeys(): void {
    const { host, onMove, rig } = this.options;
    this.listen(host, "keydown", (event) => {
      if (this.onKey(event)) event.preventDefault();
    });
    this.listen(host, "keyup", (event) => {
      if (this.keys.up(event.code, event.shiftKey)) this.drive();
    });
    this.listen(host, "focusout", () => {
      this.keys.clear();
      rig.drive(NO_DRIVE);
    });
    this.listen(host, "focusin", () => onMove());
  }

  private onDown(event: PointerEvent): void {
    if (event.button > 2) return;
    const { view } = this.options;
    view.setPointerCapture(event.pointerId);
    view.classList.add("grabbing");
    this.gestures.down({ ...inputOf(event), pans: event.button !== 0 || event.shiftKey });
  }

  private onPointerMove(event: PointerEvent): void {
    if (event.movementX !== 0 || event.movementY !== 0) this.isHovered = true;
    if (this.gestures.move(inputOf(event))) this.options.onMove();
  }

  private onUp(event: PointerEvent): void {
    const isTap = this.gestures.up(inputOf(event));
    if (!this.gestures.active) this.options.view.classList.remove("grabbing");
    if (isTap && event.button === 0) this.options.onTap(event);
    this.options.onMove(); // inertia
  }

  private onWheel(event: WheelEvent): void {
    const { host, rig, onMove } = this.options;
    if (!this.isHovered && !host.matches(":focus-within, :focus, :fullscreen")) return;
    event.preventDefault();
    const unit = event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? 1 : LINE_HEIGHT;
    rig.zoom(Math.exp(event.deltaY * unit * WHEEL_ZOOM));
    onMove();
  }

  private onKey(event: KeyboardEvent): boolean {
    const { rig, flies, onMove } = this.options;
    if (event.ctrlKey || event.altKey || event.metaKey) return false;
    if (flies && this.keys.down(event.code, event.shiftKey)) {
      this.drive();
      return true;
    }
    const action = cameraKey(event);
    if (action === null) return false;
    if (action.type === "rotate") rig.rotate(action.right, action.up);
    else if (action.type === "zoom") rig.zoom(action.factor);
    else rig.reset();
    onMove();
    return true;
  }

  private drive(): void {
    this.options.rig.drive(this.keys.drive());
    this.options.onMove();
  }

  /**
   * Returns whether a gamepad has to be read again: if the player is focused, hovered or
   * fullscreen.
   */
  private readPads(): boolean {
    const { host, rig, onPadAction } = this.options;
    const pads = navigator.getGamepads?.().filter((pad) => pad?.mapping === "standard") ?? [];
    if (pads.length === 0) return false;
    const active = document.hasFocus() && host.matches(":focus-within, :hover, :fullscreen");
    const sum: Drive = { ...this.keys.drive() };
    for (const pad of active ? pads : []) {
      if (pad === null) continue;
      const reader = this.pads.get(pad.index) ?? new PadReader();
      this.pads.set(pad.index, reader);
      const { drive, actions } = reader.read(pad);
      for (const axis of ["right", "up", "forward", "turnRight", "turnUp"] as const) {
        sum[axis] += drive[axis];
      }
      sum.boost = Math.max(sum.boost, drive.boost);
      actions.forEach(onPadAction);
    }
    rig.drive(sum);
    return active;
  }

  private listen<K extends keyof HTMLElementEventMap>(
    target: HTMLElement, type: K, listener: (event: HTMLElementEventMap[K]) => void,
    options: AddEventListenerOptions = {},
  ): void {
    target.addEventListener(type, listener, { ...options, signal: this.abort.signal });
  }
}

function inputOf(event: PointerEvent) {
  return {
    id: event.pointerId, x: event.clientX, y: event.clientY, time: event.timeStamp, pans: false,
  };
}
