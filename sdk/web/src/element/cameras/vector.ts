// SPDX-License-Identifier: Apache-2.0
// Vectors of three numbers, and the pose of a camera.
import { Camera } from "../../types";

export type Vector = readonly [number, number, number];

export const add = (a: Vector, b: Vector): Vector => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const scaled = (a: Vector, s: number): Vector => [a[0] * s, a[1] * s, a[2] * s];
export const subtract = (a: Vector, b: Vector): Vector => add(a, scaled(b, -1));
export const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const length = (a: Vector): number => Math.hypot(a[0], a[1], a[2]);
export const unit = (a: Vector): Vector => scaled(a, 1 / length(a));
export const clamp = (x: number, min: number, max: number): number =>
  Math.min(Math.max(x, min), max);

export function cross(a: Vector, b: Vector): Vector {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

/** Rotates by `angle` radians about a unit vector, by the right-hand rule. */
export function rotated(v: Vector, axis: Vector, angle: number): Vector {
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(
    add(scaled(v, c), scaled(cross(axis, v), s)),
    scaled(axis, dot(axis, v) * (1 - c)),
  );
}

/** Axes of a camera in the world: right, down and forward. */
export interface Axes {
  right: Vector;
  down: Vector;
  forward: Vector;
}

export function axesOf({ rotation: r }: Camera): Axes {
  return { right: [r[0], r[1], r[2]], down: [r[3], r[4], r[5]], forward: [r[6], r[7], r[8]] };
}

export function positionOf(camera: Camera): Vector {
  const { right, down, forward } = axesOf(camera);
  const [x, y, z] = camera.translation;
  return scaled(add(add(scaled(right, x), scaled(down, y)), scaled(forward, z)), -1);
}

/** Turns axes to the right and up by angles in radians: about `up`, and about the right axis. */
export function turned(axes: Axes, up: Vector, angleRight: number, angleUp: number): Axes {
  const turn = (v: Vector) => rotated(rotated(v, axes.right, angleUp), up, -angleRight);
  return { right: turn(axes.right), down: turn(axes.down), forward: turn(axes.forward) };
}

/** Returns `camera` at another pose. */
export function posed(camera: Camera, axes: Axes, position: Vector): Camera {
  const rows = [axes.right, axes.down, axes.forward];
  return {
    ...camera,
    rotation: rows.flatMap((row) => [...row]),
    translation: rows.map((row) => -dot(row, position)),
  };
}
