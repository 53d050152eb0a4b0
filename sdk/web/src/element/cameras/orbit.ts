// SPDX-License-Identifier: Apache-2.0
import { Camera, SceneInfo } from "../../types";
import { CameraView, Drive, largerSide, MovingRig, RigStart, viewFrom } from "./rig";
import { add, Axes, clamp, length, scaled, subtract, turned, Vector } from "./vector";

const MAX_ELEVATION = 1.5; // radians from the start, if not limited: short of the poles
const DRIVE_TURN = 1.2; // radians per second
const DRIVE_PAN = 0.4; // of the image's larger side per second
const DRIVE_ZOOM = 2; // factor of the distance per second

/** How far an orbit may leave the start camera. */
export interface OrbitLimits {
  /** Radians to each side, and up and down. */
  azimuth: number;
  elevation: number;
  /** Factors of the start distance. */
  nearest: number;
  farthest: number;
  /** Of the centre from its start, scene units. */
  pan: number;
}

export interface OrbitOptions {
  /** Lifts the limits. */
  free?: boolean;
  /** Ends a rotation with its drag. */
  reducedMotion?: boolean;
}

/**
 * Derives the limits from the start camera. A scene states no range of captured directions; the
 * field of view stands for it, since neighbouring cameras of a capture have overlapping views. The
 * azimuth may leave the start by the horizontal field of view, at least 20 and at most 75 degrees;
 * the elevation by half the vertical one, 10 to 40 degrees.
 */
export function orbitLimits({ camera, distance }: RigStart): OrbitLimits {
  const degrees = Math.PI / 180;
  const horizontal = 2 * Math.atan(camera.width / (2 * camera.fx));
  const vertical = 2 * Math.atan(camera.height / (2 * camera.fy));
  return {
    azimuth: clamp(horizontal, 20 * degrees, 75 * degrees),
    elevation: clamp(vertical / 2, 10 * degrees, 40 * degrees),
    nearest: 0.3,
    farthest: 1.6,
    pan: 0.4 * distance,
  };
}

const NO_LIMITS: OrbitLimits = {
  azimuth: Infinity, elevation: MAX_ELEVATION, nearest: 1e-3, farthest: 1e6, pan: Infinity,
};

/**
 * Orbits around a point on the optical axis of the start camera, at the depth of the scene's
 * centre.
 */
export class OrbitCamera extends MovingRig {
  /** Radians. */
  readonly limits: OrbitLimits;
  private azimuth = 0; // of the camera around the centre, radians to the right
  private elevation = 0; // radians up
  private distance: number; // scene units
  private offset: Vector = [0, 0, 0]; // of the centre from its start

  constructor(info: SceneInfo, { free = false, reducedMotion = false }: OrbitOptions = {}) {
    super(info, reducedMotion);
    this.limits = free ? NO_LIMITS : orbitLimits(this.start);
    this.distance = this.start.distance;
  }

  /** The camera moves to the left as the content follows the pointer to the right. */
  override rotate(right: number, up: number): void {
    this.turnTo(this.azimuth - right, this.elevation - up);
  }

  override pan(right: number, up: number): void {
    const scale = this.distance * largerSide(this.start);
    const axes = this.axes();
    const step = add(scaled(axes.right, -right * scale), scaled(axes.down, up * scale));
    this.moveCentre(add(this.offset, step));
  }

  override zoom(factor: number): void {
    this.setDistance(this.distance * factor);
  }

  protected override where(): CameraView {
    const { azimuth, elevation, distance } = this;
    const [x, y, z] = add(this.startCentre(), this.offset);
    return { azimuth, elevation, point: [x, y, z], distance };
  }

  protected override moveTo({ azimuth, elevation, point, distance }: CameraView): void {
    this.turnTo(azimuth, elevation);
    this.moveCentre(subtract(point, this.startCentre()));
    this.setDistance(distance);
  }

  protected override returnToStart(): void {
    this.azimuth = this.elevation = 0;
    this.offset = [0, 0, 0];
    this.distance = this.start.distance;
  }

  override camera(width: number, height: number): Camera {
    const centre = add(this.startCentre(), this.offset);
    const now = this.axes();
    const behind = add(centre, scaled(now.forward, -this.distance));
    return viewFrom(this.start, now, behind, width, height);
  }

  private startCentre(): Vector {
    const { position, axes, distance } = this.start;
    return add(position, scaled(axes.forward, distance));
  }

  private turnTo(right: number, up: number): void {
    const { azimuth, elevation } = this.limits;
    this.azimuth = clamp(right, -azimuth, azimuth);
    this.elevation = clamp(up, -elevation, elevation);
  }

  private moveCentre(offset: Vector): void {
    const excess = length(offset) / this.limits.pan;
    this.offset = excess > 1 ? scaled(offset, 1 / excess) : offset;
  }

  private setDistance(distance: number): void {
    const { nearest, farthest } = this.limits;
    this.distance = clamp(distance, nearest * this.start.distance, farthest * this.start.distance);
  }

  private axes(): Axes {
    // A camera to the right of the centre looks to the left.
    return turned(this.start.axes, this.start.up, -this.azimuth, -this.elevation);
  }

  protected override follow(drive: Drive, seconds: number): void {
    const step = seconds * drive.boost;
    this.rotate(-drive.turnRight * DRIVE_TURN * step, -drive.turnUp * DRIVE_TURN * step);
    this.pan(-drive.right * DRIVE_PAN * step, -drive.up * DRIVE_PAN * step);
    this.zoom(Math.pow(DRIVE_ZOOM, -drive.forward * step));
  }
}
