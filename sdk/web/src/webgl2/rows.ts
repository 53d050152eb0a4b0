// SPDX-License-Identifier: Apache-2.0

interface Range {
  first: number;
  count: number;
}

/** Allocates ranges of the rows of an atlas, first fit. */
export class RowAllocator {
  private free: Range[] = []; // ascending, not adjacent
  private total = 0;

  /** The number of rows, allocated and free. */
  get rows(): number {
    return this.total;
  }

  /** Returns the first of `count` > 0 rows, or -1 if no free range is as long. */
  allocate(count: number): number {
    const k = this.free.findIndex((range) => range.count >= count);
    const range = this.free[k];
    if (range === undefined) return -1;
    const first = range.first;
    range.first += count;
    range.count -= count;
    if (range.count === 0) this.free.splice(k, 1);
    return first;
  }

  /** Frees rows that allocate() returned. */
  release(first: number, count: number): void {
    let k = this.free.findIndex((range) => range.first > first);
    if (k < 0) k = this.free.length;
    this.free.splice(k, 0, { first, count });
    this.merge(k);
    if (k > 0) this.merge(k - 1);
  }

  /** Adds free rows at the end, up to `rows` in total. */
  grow(rows: number): void {
    if (rows <= this.total) return;
    const first = this.total;
    this.total = rows;
    this.release(first, rows - first);
  }

  /** Returns the total that makes `count` rows fit by growing at the end. */
  rowsFor(count: number): number {
    const last = this.free[this.free.length - 1];
    const tail = last !== undefined && last.first + last.count === this.total ? last.count : 0;
    return this.total + Math.max(0, count - tail);
  }

  private merge(k: number): void {
    const a = this.free[k];
    const b = this.free[k + 1];
    if (a === undefined || b === undefined || a.first + a.count !== b.first) return;
    a.count += b.count;
    this.free.splice(k + 1, 1);
  }
}
