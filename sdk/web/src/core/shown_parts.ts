// SPDX-License-Identifier: Apache-2.0
// The parts of decoded segments until the page has them, and those that the page has.
import type { CoreMessage } from "../types";
import type { SegmentChange } from "./module";
import type { Part } from "./part_decoder";

/** Ids of parts on the page: this many for each segment, which is more than a segment can have. */
const PARTS_PER_SEGMENT = 2 ** 16;

type Post = (message: CoreMessage, transfer: Transferable[]) => void;

/** The parts of one file. */
export class ShownParts {
  private readonly decoded = new Map<number, Part[]>(); // by the id of their decoding
  private readonly shown = new Map<number, number>(); // parts on the page, by segment

  constructor(private readonly shDegree: number, private readonly post: Post) {}

  /** Keeps the parts of a decoding until show() or release(). */
  keep(id: number, parts: Part[]): void {
    this.decoded.set(id, parts);
  }

  /** Passes a segment to the page, in place of its earlier version, or drops it. */
  show({ segment, decoded, begin, end, origin }: SegmentChange): void {
    const parts = this.decoded.get(decoded) ?? [];
    this.decoded.delete(decoded);
    const first = segment * PARTS_PER_SEGMENT;
    parts.forEach(({ primitives, words }, i) => {
      const message = { id: first + i, primitives, shDegree: this.shDegree, begin, end, origin, words };
      this.post({ type: "segment", segment: message }, [words]);
    });
    for (let i = parts.length; i < (this.shown.get(segment) ?? 0); ++i) this.post({ type: "dropped", id: first + i }, []);
    if (parts.length > 0) this.shown.set(segment, parts.length);
    else this.shown.delete(segment);
  }

  /** Forgets the parts of a decoding that is no longer needed. */
  release(id: number): void {
    this.decoded.delete(id);
  }
}
