// SPDX-License-Identifier: Apache-2.0
import { RowAllocator } from "../webgl2/rows";
import { maxStorageBytes } from "./gpu";
import { BUFFER_USAGE } from "./webgpu_types";
import type { GPUBuffer, GPUDevice } from "./webgpu_types";

/** Sizes of packed segments are multiples of this, bytes. */
const kUnit = 2048;
const kMinPageBytes = 8 << 20;
const kMaxPageBytes = 128 << 20;

/** A buffer with the words of several segments. */
export interface Page {
  readonly buffer: GPUBuffer;
  /** Bytes. */
  readonly size: number;
}

/** Where the words of a segment are. */
export interface Range {
  readonly page: Page;
  /** Bytes. */
  readonly offset: number;
  readonly size: number;
}

interface OwnedPage extends Page {
  readonly units: RowAllocator;
  used: number; // bytes
}

/**
 * The words of all segments, in as many buffers as they need. A buffer is never copied, and
 * destroyed once it is empty.
 */
export class Pages {
  private pages: OwnedPage[] = [];

  constructor(private readonly device: GPUDevice) {}

  /** Bytes of all buffers. */
  get bytes(): number {
    return this.pages.reduce((sum, page) => sum + page.size, 0);
  }

  /** Uploads words, at least one byte. Throws an Error if a buffer cannot be as large. */
  add(words: ArrayBuffer): Range {
    const size = words.byteLength;
    const units = Math.ceil(size / kUnit);
    let first = -1;
    let page = this.pages.find((one) => (first = one.units.allocate(units)) >= 0);
    if (page === undefined) {
      page = this.grow(units * kUnit);
      first = page.units.allocate(units);
    }
    page.used += size;
    this.device.queue.writeBuffer(page.buffer, first * kUnit, words);
    return { page, offset: first * kUnit, size };
  }

  /** Frees the words that add() uploaded. */
  remove(range: Range): void {
    const page = range.page as OwnedPage;
    page.units.release(range.offset / kUnit, Math.ceil(range.size / kUnit));
    page.used -= range.size;
    if (page.used > 0) return;
    page.buffer.destroy();
    this.pages = this.pages.filter((one) => one !== page);
  }

  destroy(): void {
    for (const page of this.pages) page.buffer.destroy();
    this.pages = [];
  }

  /** Adds a page as large as all others together, within limits, and for at least `bytes`. */
  private grow(bytes: number): OwnedPage {
    const limit = Math.floor(maxStorageBytes(this.device) / kUnit) * kUnit;
    if (bytes > limit) {
      throw new Error(
        `a segment of ${bytes} bytes is larger than a buffer of this GPU can be (${limit} bytes)`);
    }
    const wanted = Math.min(kMaxPageBytes, Math.max(kMinPageBytes, this.bytes));
    const size = Math.min(limit, Math.max(bytes, wanted));
    const usage = BUFFER_USAGE.STORAGE | BUFFER_USAGE.COPY_DST;
    const page = {
      buffer: this.device.createBuffer({ size, usage }), size, units: new RowAllocator(), used: 0,
    };
    page.units.grow(Math.floor(size / kUnit));
    this.pages.push(page);
    return page;
  }
}
