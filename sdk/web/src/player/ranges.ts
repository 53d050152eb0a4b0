// SPDX-License-Identifier: Apache-2.0

/** Ranges of time in seconds, sorted, with the interface of the DOM's `TimeRanges`. */
export class BufferedRanges {
  private readonly ranges: readonly (readonly [number, number])[];

  constructor(ranges: readonly (readonly [number, number])[]) {
    this.ranges = ranges.map(([begin, end]) => [begin, end] as const);
  }

  get length(): number {
    return this.ranges.length;
  }

  /** Throws an `IndexSizeError` if there is no such range, as does `end`. */
  start(index: number): number {
    return this.at(index)[0];
  }

  end(index: number): number {
    return this.at(index)[1];
  }

  /** Whether a range contains `seconds`, up to `tolerance` seconds beyond its ends. */
  covers(seconds: number, tolerance: number): boolean {
    return this.ranges.some(([a, b]) => seconds >= a - tolerance && seconds <= b + tolerance);
  }

  equals(other: BufferedRanges): boolean {
    return (
      this.length === other.length &&
      this.ranges.every(([a, b], i) => a === other.ranges[i][0] && b === other.ranges[i][1])
    );
  }

  private at(index: number): readonly [number, number] {
    const range = this.ranges[index];
    if (range === undefined) {
      const message = `no range has index ${index} (expected 0 to ${this.length - 1})`;
      throw new DOMException(message, "IndexSizeError");
    }
    return range;
  }
}
