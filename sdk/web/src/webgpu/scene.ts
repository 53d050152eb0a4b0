// SPDX-License-Identifier: Apache-2.0
import { checkWords, padded } from "../packed_segment";
import type { PackedSegment } from "../types";
import { GrowingBuffer } from "./gpu";
import { Pages } from "./pages";
import type { Page, Range } from "./pages";
import { BUFFER_USAGE } from "./webgpu_types";
import type { GPUBufferBinding, GPUDevice } from "./webgpu_types";

interface Resident {
  id: number;
  primitives: number;
  shDegree: number;
  begin: number; // ticks of the timeline; end inclusive
  end: number;
  origin: number;
  range: Range | null; // null: it has no primitives
}

/** The segments of one page that are shown. */
export interface Batch {
  words: GPUBufferBinding;
  /** Their part of `groups` of project.wgsl, and how many groups it has. */
  groups: GPUBufferBinding;
  count: number;
}

/** Words per segment in `segments` of project.wgsl. */
const kSegmentWords = 8;
/** Groups that a binding can begin at a multiple of: 256 bytes. */
const kGroupAlignment = 32;

/** The segments on the GPU, and the tables of those that are shown. */
export class SplatScene {
  private readonly pages: Pages;
  private readonly residents = new Map<number, Resident>();
  private readonly segmentTable: GrowingBuffer;
  private readonly groupTable: GrowingBuffer;
  private shown: Resident[] = [];
  private isOutdated = false; // `shown`, since a segment was added or removed
  private current: Batch[] = [];
  private slotCount = 0;
  private total = 0;

  constructor(private readonly device: GPUDevice) {
    this.pages = new Pages(device);
    this.segmentTable = new GrowingBuffer(device, BUFFER_USAGE.STORAGE, "the segments");
    this.groupTable = new GrowingBuffer(device, BUFFER_USAGE.STORAGE, "the groups");
  }

  /** Primitives of all segments. */
  get primitives(): number {
    return this.total;
  }

  /** Bytes of the buffers with segments. */
  get bytes(): number {
    return this.pages.bytes;
  }

  /** The primitives that are shown, each segment padded to a multiple of 256. */
  get slots(): number {
    return this.slotCount;
  }

  get batches(): readonly Batch[] {
    return this.current;
  }

  /** `segments` of project.wgsl; only if slots > 0. */
  get segments(): GPUBufferBinding {
    return { buffer: this.segmentTable.buffer };
  }

  /** Uploads a segment; it replaces an earlier version. Throws an Error if that is impossible. */
  add(segment: PackedSegment): void {
    checkWords(segment);
    const { id, primitives, shDegree, begin, end, origin, words } = segment;
    const range = primitives > 0 ? this.pages.add(words) : null;
    this.remove(id);
    this.residents.set(id, { id, primitives, shDegree, begin, end, origin, range });
    this.total += primitives;
    this.isOutdated = true;
  }

  /** Removes a segment, if there is one with this id. */
  remove(id: number): void {
    const resident = this.residents.get(id);
    if (resident === undefined) return;
    if (resident.range !== null) this.pages.remove(resident.range);
    this.residents.delete(id);
    this.total -= resident.primitives;
    this.isOutdated = true;
  }

  clear(): void {
    for (const id of [...this.residents.keys()]) this.remove(id);
  }

  /**
   * Uploads the tables for a time, ticks of the timeline. Returns whether batches and bindings have
   * changed.
   */
  prepare(ticks: number): boolean {
    const shown = [...this.residents.values()].filter(
      ({ begin, end, range }) => range !== null && begin <= ticks && ticks <= end);
    shown.sort((a, b) => a.id - b.id);
    const isSame = !this.isOutdated && shown.length === this.shown.length &&
      shown.every((resident, k) => resident === this.shown[k]);
    this.shown = shown;
    this.isOutdated = !isSame; // until the tables are complete: their buffers may be too small
    this.slotCount = shown.reduce((sum, { primitives }) => sum + padded(primitives), 0);
    if (shown.length === 0) {
      this.current = [];
    } else {
      this.segmentTable.reserve(4 * kSegmentWords * shown.length);
      if (!isSame) this.uploadGroups();
      this.uploadSegments(ticks);
    }
    this.isOutdated = false;
    return !isSame;
  }

  destroy(): void {
    this.pages.destroy();
    this.segmentTable.destroy();
    this.groupTable.destroy();
  }

  private uploadSegments(ticks: number): void {
    const words = new Uint32Array(kSegmentWords * this.shown.length);
    const floats = new Float32Array(words.buffer);
    let slot = 0;
    this.shown.forEach(({ range, primitives, shDegree, origin }, k) => {
      const n = padded(primitives);
      const local = ticks - origin;
      words.set([(range as Range).offset / 8, n, shDegree, slot, primitives], kSegmentWords * k);
      words[kSegmentWords * k + 7] = this.slotCount;
      floats.set([local, local - Math.fround(local)], kSegmentWords * k + 5);
      slot += n;
    });
    this.device.queue.writeBuffer(this.segmentTable.buffer, 0, words);
  }

  /** Writes `groups` of project.wgsl, page by page. */
  private uploadGroups(): void {
    const byPage = new Map<Page, number[]>();
    this.shown.forEach(({ range, primitives }, k) => {
      const { page } = range as Range;
      const list = byPage.get(page) ?? [];
      for (let group = 0; group < padded(primitives) / 256; ++group) list.push(k, group);
      byPage.set(page, list);
    });
    const aligned = (list: number[]) => Math.ceil(list.length / 2 / kGroupAlignment) * kGroupAlignment;
    let total = 0;
    for (const list of byPage.values()) total += aligned(list);
    this.groupTable.reserve(8 * total);
    const words = new Uint32Array(2 * total);
    const { buffer } = this.groupTable;
    let first = 0;
    this.current = [...byPage].map(([page, list]) => {
      words.set(list, 2 * first);
      const groups = { buffer, offset: 8 * first, size: 4 * list.length };
      first += aligned(list);
      return { words: { buffer: page.buffer }, groups, count: list.length / 2 };
    });
    this.device.queue.writeBuffer(buffer, 0, words);
  }
}
