// SPDX-License-Identifier: Apache-2.0
// Where a scene stands in the room of a headset.
import { startCameraOf } from "../player/fit_camera";
import { rigStart } from "../element/cameras/rig";
import { cross, dot, length, scaled, subtract, unit, Vector } from "../element/cameras/vector";
import { SceneInfo } from "../types";

const EYE_HEIGHT = 1.6; // metres, where the start camera is if the floor is unknown
const DISTANCE = 2; // metres to the scene's centre, if its scale is unknown
const MIN_LENGTH = 1e-3; // of a unit vector's share in the floor

/** Settings of the placement. */
export interface Placement {
  /** Metres per scene unit; undefined: that of the scene. */
  metresPerUnit?: number | undefined;
  /** Whether the origin of the room is on its floor; otherwise it is at the viewer's eyes. */
  isOnFloor: boolean;
}

/** Returns the part of `v` in the plane of the floor as a unit vector; null: it has none. */
function level(v: Vector, up: Vector): Vector | null {
  const flat = subtract(v, scaled(up, dot(v, up)));
  return length(flat) > MIN_LENGTH ? unit(flat) : null;
}

/**
 * Returns the matrix from the scene to the room, column by column; the room is in metres, its y
 * axis points up and -z ahead. The viewer stands at the start camera and looks where it looks, on
 * the level. The scene's floor is that of the room. Without one, the start camera is 1.6 m above
 * the room's floor. A scene of unknown scale has its centre 2 m ahead.
 */
export function roomFromScene(info: SceneInfo, placement: Placement): number[] {
  const start = rigStart({ ...info, startCamera: startCameraOf(info) });
  const { axes, position, distance } = start;
  const up = unit(start.up);
  // A camera that looks straight down or up has its upper edge ahead, or behind.
  const ahead = level(axes.forward, up) ?? level(scaled(axes.down, -1), up) ?? axes.right;
  const rows = [cross(ahead, up), up, scaled(ahead, -1)];
  const scale = placement.metresPerUnit ?? info.metresPerUnit ?? DISTANCE / distance;
  const [x, y, z] = rows.map((row) => scale * dot(row, position)) as [number, number, number];
  const height = heightOf(info, up, position, scale);
  const origin = [-x, (placement.isOnFloor ? height : 0) - y, -z];
  const columns = [0, 1, 2].flatMap((k) => [...rows.map((row) => scale * (row[k] ?? 0)), 0]);
  return [...columns, ...origin, 1];
}

/** The height of the start camera above the floor, metres. */
function heightOf({ floor }: SceneInfo, up: Vector, position: Vector, scale: number): number {
  if (floor === null) return EYE_HEIGHT;
  const [x, y, z] = floor as [number, number, number];
  return scale * dot(up, subtract(position, [x, y, z]));
}
