// SPDX-License-Identifier: Apache-2.0
import type { PackedSegment } from "../types";
import type { Atlas } from "./atlas";
import type { Drawn } from "./splat_drawer";

/** A version of a segment whose words are on the GPU. */
export interface Resident extends Drawn {
  key: number;
  id: number;
}

/**
 * The segments of a renderer. A removed one stays on the GPU while the current order has entries of
 * it, so that a replaced segment remains visible until an order of the new version arrives.
 */
export class Residents {
  private readonly byId = new Map<number, Resident>();
  private readonly byKey = new Map<number, Resident>(); // also the removed ones
  private nextKey = 0;
  /** Primitives of the segments that were not removed. */
  primitives = 0;

  /** Returns the ids of the segments that were not removed. */
  ids(): number[] {
    return [...this.byId.keys()];
  }

  /** Adds a segment, without rows. The caller removes an earlier version before. */
  add(segment: PackedSegment): Resident {
    const { id, primitives, shDegree, begin, end, origin } = segment;
    const resident: Resident = {
      key: this.nextKey++, id, primitives, shDegree, begin, end, origin, rows: null,
    };
    this.byId.set(id, resident);
    this.byKey.set(resident.key, resident);
    this.primitives += primitives;
    return resident;
  }

  /** Removes the segment with an id. Returns its last version, or null if there is none. */
  remove(id: number): Resident | null {
    const resident = this.byId.get(id);
    if (resident === undefined) return null;
    this.byId.delete(id);
    this.primitives -= resident.primitives;
    return resident;
  }

  /** Returns the version with a key, or null if it is no longer on the GPU. */
  at(key: number): Resident | null {
    return this.byKey.get(key) ?? null;
  }

  /** Returns all versions with these keys, in their order. */
  list(keys: readonly number[]): Resident[] {
    return keys.map((key) => this.byKey.get(key) as Resident);
  }

  /** Frees the removed versions, except those of an order. */
  release(kept: readonly number[], atlas: Atlas | null): void {
    const inUse = new Set(kept);
    for (const [key, resident] of this.byKey) {
      if (inUse.has(key) || this.byId.get(resident.id) === resident) continue;
      if (resident.rows !== null) atlas?.remove(resident.rows);
      this.byKey.delete(key);
    }
  }

  /** Removes all versions, which are not drawn any more: the scene has ended. */
  clear(): void {
    this.byId.clear();
    this.primitives = 0;
    for (const resident of this.byKey.values()) resident.begin = Infinity;
  }

  /** States that no words are on the GPU any more. */
  forgetRows(): void {
    for (const resident of this.byKey.values()) resident.rows = null;
  }
}
