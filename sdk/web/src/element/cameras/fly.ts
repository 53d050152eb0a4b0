// SPDX-License-Identifier: Apache-2.0
import { Camera, SceneInfo } from "../../types";
import { CameraView, Drive, largerSide, MovingRig, viewFrom } from "./rig";
import { add, Axes, clamp, scaled, turned, Vector } from "./vector";

const MAX_PITCH = 1.5; // radians from the start
const FLY_SPEED = 0.5; // start distances per second
const FLY_TURN = 1.5; // radians per second
const ZOOM_REACH = 0.5; // start distances that a zoom by the factor e moves

export interface FlyOptions {
  /** Ends a rotation with its drag. */
  reducedMotion?: boolean;
}

/**
 * Moves freely along the axes of the camera and turns in place. Up stays that of the start.
 */
export class FlyCamera extends MovingRig {
  private yaw = 0; // radians to the right
  private pitch = 0; // radians up
  private position: Vector;

  constructor(info: SceneInfo, { reducedMotion = false }: FlyOptions = {}) {
    super(info, reducedMotion);
    this.position = this.start.position;
  }

  /** The camera turns to the left as the content follows the pointer to the right. */
  override rotate(right: number, up: number): void {
    this.turn(-right, -up);
  }

  override pan(right: number, up: number): void {
    const scale = this.start.distance * largerSide(this.start);
    this.move(-right * scale, -up * scale, 0);
  }

  /** Moves ahead for factors below 1, and back for others. */
  override zoom(factor: number): void {
    this.move(0, 0, -Math.log(factor) * ZOOM_REACH * this.start.distance);
  }

  protected override returnToStart(): void {
    this.yaw = this.pitch = 0;
    this.position = this.start.position;
  }

  protected override where(): CameraView {
    const [x, y, z] = this.position;
    return { azimuth: this.yaw, elevation: this.pitch, point: [x, y, z], distance: 0 };
  }

  protected override moveTo({ azimuth, elevation, point }: CameraView): void {
    this.yaw = azimuth;
    this.pitch = clamp(elevation, -MAX_PITCH, MAX_PITCH);
    this.position = point;
  }

  protected override follow(drive: Drive, seconds: number): void {
    const { right, up, forward, turnRight, turnUp, boost } = drive;
    const step = FLY_SPEED * this.start.distance * boost * seconds;
    this.turn(turnRight * FLY_TURN * seconds, turnUp * FLY_TURN * seconds);
    this.move(right * step, up * step, forward * step);
  }

  override camera(width: number, height: number): Camera {
    return viewFrom(this.start, this.axes(), this.position, width, height);
  }

  private turn(right: number, up: number): void {
    this.yaw += right;
    this.pitch = clamp(this.pitch + up, -MAX_PITCH, MAX_PITCH);
  }

  private move(right: number, up: number, forward: number): void {
    const axes = this.axes();
    const across = add(scaled(axes.right, right), scaled(axes.down, -up));
    this.position = add(this.position, add(across, scaled(axes.forward, forward)));
  }

  private axes(): Axes {
    return turned(this.start.axes, this.start.up, this.yaw, this.pitch);
  }
}
