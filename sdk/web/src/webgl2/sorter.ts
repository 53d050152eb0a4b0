// SPDX-License-Identifier: Apache-2.0
// The depth order of active primitives. Runs in a worker (sorter_worker.ts), in tests in-process.
import { padded } from "../packed_segment";

/** A segment to be sorted. */
export interface SorterSegment {
  /** Unique among the segments of a sorter. */
  key: number;
  /** Of the segment. Primitives are numbered segment by segment, in ascending order of it. */
  id: number;
  /** N. */
  primitives: number;
  /** Ticks of the timeline at which it is needed; end inclusive. */
  begin: number;
  end: number;
  /** Ticks of the timeline from which its times count. */
  origin: number;
  /**
   * The words of a packed segment (packed_segment.h), or only its first `kSorterBytes` per entry:
   * supports, positions, times and velocities. Owned by the sorter from then on.
   */
  words: ArrayBuffer;
}

/** Bytes per entry of a packed segment that a sorter reads. */
export const kSorterBytes = 40;

/** For which camera and time to sort. */
export interface SortRequest {
  /** Depth of a point p of the world: dot(direction, p) + offset, scene units. */
  direction: [number, number, number];
  offset: number;
  /** Scene units, > 0. The order of nearer primitives is unspecified. */
  near: number;
  /** Ticks of the timeline. Depths are those at this time. */
  ticks: number;
  /** Primitives that are active at some time between `ticks` and this one, in ticks, are sorted. */
  until: number;
}

/** Active primitives, farthest first; at equal depth, those with higher numbers first. */
export interface Order {
  /**
   * 32-bit entries: the index of the primitive in its segment plus the base of the segment. May be
   * larger than `count` entries.
   */
  buffer: ArrayBuffer;
  count: number;
  /** Of the segments that are shown at these times: keys, and bases, which are multiples of 256. */
  keys: number[];
  bases: number[];
}

const kBins = 65536;
const kMaxDepth = 3.4e38;

interface Resident {
  segment: SorterSegment;
  floats: Float32Array;
}

/** Sorts the active primitives of the segments that were added. */
export class DepthSorter {
  private residents: Resident[] = []; // ascending ids
  private entries = new Uint32Array(0);
  private depths = new Float32Array(0);
  private bits = new Uint32Array(0); // of `depths`
  private readonly ends = new Uint32Array(kBins);

  /** Adds a segment. */
  add(segment: SorterSegment): void {
    const after = this.residents.findIndex((other) => other.segment.id > segment.id);
    const at = after < 0 ? this.residents.length : after;
    this.residents.splice(at, 0, { segment, floats: new Float32Array(segment.words) });
  }

  /** Removes the segment with a key, if there is one. */
  remove(key: number): void {
    this.residents = this.residents.filter((resident) => resident.segment.key !== key);
  }

  /** Returns all segments, ascending by id. */
  segments(): SorterSegment[] {
    return this.residents.map((resident) => resident.segment);
  }

  /** Sorts. Uses `buffer`, if it is large enough, for the result. */
  sort(request: SortRequest, buffer: ArrayBuffer | null): Order {
    const first = Math.min(request.ticks, request.until);
    const last = Math.max(request.ticks, request.until);
    const shown = this.residents.filter(
      ({ segment }) => segment.begin <= last && first <= segment.end);
    this.reserve(shown.reduce((sum, { segment }) => sum + segment.primitives, 0));
    const bases: number[] = [];
    let count = 0;
    let base = 0;
    for (const resident of shown) {
      bases.push(base);
      count = this.collect(resident, request, base, count);
      base += padded(resident.segment.primitives);
    }
    const large = buffer !== null && buffer.byteLength >= 4 * count;
    const out = large ? buffer : new ArrayBuffer(4 * Math.ceil(1.25 * count));
    this.scatter(count, new Uint32Array(out));
    return { buffer: out, count, keys: shown.map(({ segment }) => segment.key), bases };
  }

  private reserve(primitives: number): void {
    if (primitives <= this.entries.length) return;
    const size = Math.ceil(1.25 * primitives);
    this.entries = new Uint32Array(size);
    this.depths = new Float32Array(size);
    this.bits = new Uint32Array(this.depths.buffer);
  }

  /** Appends the active primitives of a segment to the first `count`. Returns their new number. */
  private collect(resident: Resident, request: SortRequest, base: number, count: number): number {
    const { segment, floats } = resident;
    const { entries, depths } = this;
    const { offset, near } = request;
    const [x, y, z] = request.direction;
    const n = padded(segment.primitives);
    const local = request.ticks - segment.origin;
    // In the precision in which the shader tests supports.
    const first = Math.fround(Math.min(local, request.until - segment.origin));
    const last = Math.fround(Math.max(local, request.until - segment.origin));
    for (let i = 0; i < segment.primitives; ++i) {
      const begin = floats[2 * i] as number;
      const end = floats[2 * i + 1] as number;
      if (!(begin <= last && first <= end)) continue;
      const p = 2 * n + 4 * i;
      const v = 6 * n + 4 * i;
      const dt = local - (floats[p + 3] as number);
      let depth =
        x * ((floats[p] as number) + (floats[v] as number) * dt) +
        y * ((floats[p + 1] as number) + (floats[v + 1] as number) * dt) +
        z * ((floats[p + 2] as number) + (floats[v + 2] as number) * dt) +
        offset;
      if (!(depth >= near && depth <= kMaxDepth)) depth = near; // not drawn
      entries[count] = base + i;
      depths[count] = depth;
      ++count;
    }
    return count;
  }

  /**
   * Writes the entries in order: a counting sort by the bits of the depths, which are ordered as
   * the depths are and have a nearly constant relative precision.
   */
  private scatter(count: number, out: Uint32Array): void {
    const { entries, bits, ends } = this;
    let low = 0xffffffff;
    let high = 0;
    for (let k = 0; k < count; ++k) {
      const b = bits[k] as number;
      if (b < low) low = b;
      if (b > high) high = b;
    }
    let shift = 0;
    while ((high - low) >>> shift >= kBins) ++shift;
    ends.fill(0);
    for (let k = 0; k < count; ++k) ++(ends[((bits[k] as number) - low) >>> shift] as number);
    let end = count;
    for (let bin = 0; bin < kBins && end > 0; ++bin) {
      const inBin = ends[bin] as number;
      ends[bin] = end;
      end -= inBin;
    }
    for (let k = 0; k < count; ++k) {
      const bin = ((bits[k] as number) - low) >>> shift;
      const to = (ends[bin] as number) - 1;
      ends[bin] = to;
      out[to] = entries[k] as number;
    }
  }
}
