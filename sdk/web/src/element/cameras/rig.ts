// SPDX-License-Identifier: Apache-2.0
// The interface of interactive cameras, and the parts that they share.
import { CameraSource } from "../../player/frame_loop";
import { fitCamera, sceneCentre, sceneDiagonal, startCameraOf } from "../../player/fit_camera";
import { Camera, SceneInfo } from "../../types";
import { Axes, axesOf, clamp, dot, positionOf, posed, subtract, Vector } from "./vector";

/** Steps of more milliseconds, such as after a sleep of the page, move the camera no further. */
const MAX_STEP = 100;
const INERTIA_TIME = 0.12; // seconds in which the speed falls to 1 / e
const MIN_SPEED = 0.002; // radians per second; slower rotations end

/** Continuous motion that held keys or sticks ask for; each from -1 to 1. */
export interface Drive {
  right: number;
  up: number;
  forward: number;
  turnRight: number;
  turnUp: number;
  /** Factor of the speed, from 1. */
  boost: number;
}

export const NO_DRIVE: Drive = { right: 0, up: 0, forward: 0, turnRight: 0, turnUp: 0, boost: 1 };

/**
 * An interactive camera: a state machine that input moves. Rotations are in radians to the right
 * and up; panning is in shares of the image's larger side.
 */
export interface CameraRig extends CameraSource {
  /** A drag: the content follows the pointer. */
  rotate(right: number, up: number): void;
  pan(right: number, up: number): void;
  /** Multiplies the distance by `factor` > 0. */
  zoom(factor: number): void;
  /** Sets the continuous motion until the next call. */
  drive(drive: Drive): void;
  /** A drag begins: ends the inertia of the last. */
  grab(): void;
  /** A drag ends, with this speed in radians per second. */
  release(right: number, up: number): void;
  /** Returns to the start camera. */
  reset(): void;
  /** The position of the camera. Assigning a view moves the camera at once, within its limits. */
  view: CameraView;
}

/** The position of a camera, relative to the start camera of the scene. */
export interface CameraView {
  /** Radians from the start camera: the angle around the centre of the orbit, or the viewing direction when flying. */
  azimuth: number; // to the right
  elevation: number; // up
  /** Scene units: the centre of the orbit, or the position of the flying camera. */
  point: [number, number, number];
  /** Scene units from the centre of the orbit; when flying, 0 and ignored. */
  distance: number;
}

/** The start of a camera, derived from the scene. */
export interface RigStart {
  camera: Camera;
  axes: Axes;
  position: Vector;
  /** Unit vector: that of the scene, or of the start camera if the scene states none. */
  up: Vector;
  /** Scene units along the optical axis to the depth of the scene's centre. */
  distance: number;
  /** Scene units. */
  diagonal: number;
}

const MIN_DISTANCE = 0.01; // scene diagonals: a centre nearer than this is not in front
const DEFAULT_DISTANCE = 0.5; // scene diagonals

export function rigStart(info: SceneInfo): RigStart {
  const camera = startCameraOf(info);
  const axes = axesOf(camera);
  const position = positionOf(camera);
  const diagonal = sceneDiagonal(info);
  const [x, y, z] = sceneCentre(info);
  const depth = dot(axes.forward, subtract([x, y, z], position));
  const distance = depth > MIN_DISTANCE * diagonal ? depth : DEFAULT_DISTANCE * diagonal;
  const [ux, uy, uz] = info.up ?? axes.down.map((v) => -v);
  return { camera, axes, position, up: [ux, uy, uz], distance, diagonal };
}

/** The camera for an image of this size, at a pose. */
export function viewFrom(start: RigStart, axes: Axes, position: Vector, width: number,
                         height: number): Camera {
  return fitCamera(posed(start.camera, axes, position), width, height);
}

/** Size of the image's larger side at distance 1. */
export function largerSide({ camera }: RigStart): number {
  return Math.max(camera.width / camera.fx, camera.height / camera.fy);
}

/** Rotation that continues after a drag and fades out. Speeds are in radians per second. */
export class Inertia {
  private right = 0;
  private up = 0;

  constructor(private readonly enabled: boolean) {}

  set(right: number, up: number): void {
    this.right = this.enabled ? right : 0;
    this.up = this.enabled ? up : 0;
  }

  /** Returns the rotation in this step, radians; null: none. */
  step(seconds: number): { right: number; up: number } | null {
    if (Math.hypot(this.right, this.up) < MIN_SPEED) return null;
    const decay = Math.exp(-seconds / INERTIA_TIME);
    const share = INERTIA_TIME * (1 - decay);
    const rotation = { right: this.right * share, up: this.up * share };
    this.set(this.right * decay, this.up * decay);
    return rotation;
  }
}

/** Measures the time between updates of a camera that moves. */
export class StepTimer {
  private last: number | null = null;

  /** Seconds since the last step, at most 0.1; 0 at the first after `stop`. */
  step(now: number): number {
    const passed = this.last === null ? 0 : clamp(now - this.last, 0, MAX_STEP);
    this.last = now;
    return passed / 1000;
  }

  /** The camera rests: the time until the next step does not count. */
  stop(): void {
    this.last = null;
  }
}

export function isDriven(drive: Drive): boolean {
  return (
    drive.right !== 0 || drive.up !== 0 || drive.forward !== 0 ||
    drive.turnRight !== 0 || drive.turnUp !== 0
  );
}

/** A camera with the motion between its inputs: inertia after a drag, and continuous motion. */
export abstract class MovingRig implements CameraRig {
  protected readonly start: RigStart;
  private readonly inertia: Inertia;
  private readonly timer = new StepTimer();
  private driven: Drive = NO_DRIVE;

  constructor(info: SceneInfo, reducedMotion: boolean) {
    this.start = rigStart(info);
    this.inertia = new Inertia(!reducedMotion);
  }

  abstract rotate(right: number, up: number): void;
  abstract pan(right: number, up: number): void;
  abstract zoom(factor: number): void;
  abstract camera(width: number, height: number): Camera;
  protected abstract where(): CameraView;
  protected abstract moveTo(view: CameraView): void;
  /** Moves continuously for some seconds. */
  protected abstract follow(drive: Drive, seconds: number): void;
  protected abstract returnToStart(): void;

  drive(drive: Drive): void {
    this.driven = drive;
  }

  grab(): void {
    this.inertia.set(0, 0);
  }

  release(right: number, up: number): void {
    this.inertia.set(right, up);
  }

  get view(): CameraView {
    return this.where();
  }
  set view(view: CameraView) {
    this.moveTo(view);
    this.inertia.set(0, 0);
  }

  reset(): void {
    this.returnToStart();
    this.inertia.set(0, 0);
  }

  update(now: number): boolean {
    const seconds = this.timer.step(now);
    const rotation = this.inertia.step(seconds);
    if (rotation !== null) this.rotate(rotation.right, rotation.up);
    const driven = isDriven(this.driven);
    if (driven) this.follow(this.driven, seconds);
    if (rotation === null && !driven) this.timer.stop();
    return rotation !== null || driven;
  }
}
